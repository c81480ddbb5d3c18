"""Proof by concealment: effects hidden by another engine, diagnosed blind, scored once the seals are open."""
