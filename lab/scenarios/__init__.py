"""Scenarios that come along, and new ones."""
