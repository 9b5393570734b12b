"""Robot files of other programs: read into this project's robot file, and written from it."""
