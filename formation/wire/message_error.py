"""What every decoder raises."""


class MessageError(ValueError):
    """Bytes that are not the message they should be; the text says why."""
