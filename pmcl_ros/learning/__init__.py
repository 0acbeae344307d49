"""Captures and pictures with truth -> the learned numbers and network of `config/learned`."""
