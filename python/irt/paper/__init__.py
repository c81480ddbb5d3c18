"""Reproduction of the paper: experiments, figures and table, compared with its numbers and other methods."""
