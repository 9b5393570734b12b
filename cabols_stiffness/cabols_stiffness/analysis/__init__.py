"""From bags to a report."""
