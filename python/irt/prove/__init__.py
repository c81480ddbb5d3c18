"""Proof by concealment: effects hidden by another engine, diagnosed blind, and scored once the seals are open."""
