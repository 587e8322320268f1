"""The JSON Schema of verdict.json, for programs that read it."""

from formnet.lab.schemas.common import Schema, dumped, finished
from formnet.lab.verdict.model import Verdict


def verdict_schema() -> Schema:
    """The schema."""
    return finished("formnet verdict", Verdict.model_json_schema())


def text() -> str:
    """The schema as it stands in a file."""
    return dumped(verdict_schema())
