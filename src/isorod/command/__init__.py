"""The isorod command."""
