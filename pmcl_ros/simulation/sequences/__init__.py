"""Sequences of moving scenes, with exact truth: what tracking is tested on."""
