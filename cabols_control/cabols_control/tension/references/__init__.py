"""Slow second opinions: enumeration of active sets, and DAQP."""
