"""A law in a file of Python, ``laws.py:MyLaw``: what is executed is what was read and hashed.

Nobody's module path is asked, no compiled copy is looked for, and the folder of the file is not
put on the path: such a file imports only what is installed. Who decides whether a file may be
executed is :mod:`lab.code`; here it is.
"""

import ast
import hashlib
import os
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from formnet.agent.law import RAISED, Law, UnknownLaw, in_words, place
from formnet.formation.briefing.situation import Situation
from formnet.netem.files import regular
from formnet.netem.files.problems import nearest

MOST_BYTES = 2**20
"""A longer file is no law."""
_UNPARSABLE = (SyntaxError, ValueError, RecursionError, MemoryError)


@dataclass(frozen=True)
class LawFile:
    """``attribute`` of the file ``path``, whose content is ``source``; called, it makes a law.

    ``kind`` is what ``law.kind`` says: the file, as it was named, and the attribute.
    """

    kind: str
    path: str
    attribute: str
    source: bytes

    @property
    def file(self) -> str:
        """The file as it was named."""
        return self.kind.rpartition(":")[0]

    @classmethod
    def read(cls, argument: str, sha256: str | None = None, kind: str | None = None) -> "LawFile":
        """The law ``FILE:NAME``, whose file must have this SHA-256, if one is given.

        Raises:
            UnknownLaw: it cannot be read, or has another.
        """
        path, _, attribute = argument.rpartition(":")
        real = Path(os.path.realpath(path))
        try:
            with regular.reading(real, MOST_BYTES) as stream:
                source = stream.read(MOST_BYTES)
        except OSError as error:
            raise UnknownLaw(f"{path} cannot be read: {error.strerror}") from None
        found = cls(kind or f"{real.name}:{attribute}", str(real), attribute, source)
        if sha256 not in (None, found.sha256):
            raise UnknownLaw(f"{path} has changed since the run began")
        return found

    @property
    def argument(self) -> str:
        """What :meth:`read` takes."""
        return f"{self.path}:{self.attribute}"

    @property
    def sha256(self) -> str:
        """SHA-256 of what is executed, in hexadecimal digits."""
        return hashlib.sha256(self.source).hexdigest()

    def problem(self) -> str | None:
        """Why it cannot be a law, as far as that is known without executing it; None if it may."""
        try:
            tree = ast.parse(self.source)
        except _UNPARSABLE as error:
            line = getattr(error, "lineno", None)
            where = self.file if line is None else f"{self.file}, line {line}"
            return f"{where}: not Python: {getattr(error, 'msg', '') or type(error).__name__}"
        names = _bound(tree)
        if not names.isdisjoint({self.attribute, "*"}):
            return None
        hint = nearest(self.attribute, names)
        return f"{self.file} defines no {self.attribute!r} at its top{hint}"

    def __call__(self, situation: Situation) -> Law:
        """The law of a robot. Executes the file, once in a process.

        Raises:
            UnknownLaw: it cannot be executed, or has no such attribute.
        """
        law: Law = _made(self)(situation)
        return law


@cache
def _made(file: LawFile) -> Any:
    """What the file calls ``attribute``, after it was executed as a module of its own."""
    name = f"formnet_law_{file.sha256[:16]}"
    module = ModuleType(name)
    module.__file__ = file.path
    sys.modules[name] = module  # as dataclasses, for one, expect of the module of a class
    try:
        exec(compile(file.source, file.path, "exec", dont_inherit=True), module.__dict__)
        return getattr(module, file.attribute)
    except (*RAISED, *_UNPARSABLE) as error:
        hint = ""
        if isinstance(error, ImportError):
            hint = ": a law in a file imports only what is installed, nothing beside it"
        raise UnknownLaw(
            f"law {file.kind!r} cannot be executed: {in_words(error)}{place(error)}{hint}"
        ) from error


def _bound(tree: ast.Module) -> set[str]:
    """The names that a module binds outside functions and classes; ``*`` if it imports that."""
    found: set[str] = set()
    waiting: list[ast.AST] = [*tree.body]
    while waiting:
        node = waiting.pop()
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
                found.add(name)
                continue
            case ast.AsyncFunctionDef() | ast.Lambda():
                continue
            case ast.Name(id=name, ctx=ast.Store()):
                found.add(name)
            case ast.alias(name=name, asname=other):
                found.add(other or name)
            case _:
                pass
        waiting.extend(ast.iter_child_nodes(node))
    return found
