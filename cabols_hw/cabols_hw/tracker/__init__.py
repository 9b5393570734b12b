"""The laser tracker: its service (tracker.proto), our client, its noise and configuration."""
