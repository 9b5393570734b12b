"""Rosbags on disk: writing, recovering, reading."""
