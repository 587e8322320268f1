"""A link: what becomes of each message, and when; no clock, socket or thread."""
