"""Proof by concealment: effects hidden by another engine, diagnosed blind, scored after unsealing."""
