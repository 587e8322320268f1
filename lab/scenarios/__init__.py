"""Scenarios that come along, new ones, and their format for editors and readers."""
