"""What everything rests on: errors, settings, compiled kernels, OpenGL contexts, resources."""
