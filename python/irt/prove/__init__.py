"""Proof by concealment: rigs of another engine with hidden physics, diagnosed blind, and the score."""
