"""Engines that nothing in this project was made with, as worlds of concealed rigs."""
