"""Physically based pictures of scenes, by Mitsuba 3 (extra `simulate`)."""
