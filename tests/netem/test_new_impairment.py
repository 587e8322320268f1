"""A new impairment is one file in netem/impairments, and nothing else has to know of it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

JAM = '''
"""Jamming: what is sent in the first tenth of a period is lost."""

from typing import ClassVar

from pydantic import Field

from formnet.netem.core.transit import LOST_RANDOM
from formnet.netem.files.tables import Seconds, nanoseconds
from formnet.netem.impairments.stage import StageTable


class Jam:
    name = "jam"

    def __init__(self, every_ns):
        self._every_ns = every_ns

    def twin(self):
        return self

    def inherit(self, before):
        pass

    def apply(self, copy, random):
        if copy.sent_ns % self._every_ns < self._every_ns // 10:
            copy.fate = LOST_RANDOM


class JamSettings(StageTable):
    """``jam = { every_s = 10.0 }``"""

    key: ClassVar[str] = "jam"
    after: ClassVar[str] = "delay"

    every_s: Seconds = Field(default=0.0, description="Time between two jams; 0: none.")

    def stages(self):
        return {"jam": lambda: Jam(nanoseconds(self.every_s))} if self.every_s else {}

    @property
    def loses(self):
        return self.every_s > 0
'''

PROGRAM = """
from formnet.formation.scenario.loading import ScenarioError, dumps, loads
from formnet.lab.scenarios.packaged import find
from formnet.netem.settings.links import PIPELINE, LinkSettings
from formnet.netem.settings.presets import PRESETS

assert list(PIPELINE).index("jam") == list(PIPELINE).index("delay") + 1
assert not LinkSettings().impairments()
settings = LinkSettings.model_validate({"preset": "lan", "jam": {"every_s": 1.0}})
assert [some.name for some in settings.impairments()] == ["delay", "jam", "rate"]
assert not settings.lossless
link = settings.link(seed=1, source=1, destination=2)
second = 10**9
lost = [copy.lost for k in range(20) for copy in link.send(k * second // 20, k, b"x")]
assert lost == [True] * 2 + [False] * 18, lost
assert not settings.changed({"jam.every_s": 0.0}).impairments()[-1].name == "jam"
text = find("section5").read_text(encoding="utf-8")
ramp = {"action": "ramp", "parameter": "jam.every_s", "at_s": 1.0, "from_value": 1.0,
        "to_value": 2.0, "duration_s": 1.0}
scenario = loads(text, "f", {"network.default.jam.every_s": 0.5, "timeline": [ramp],
                             "network.links": [{"from": 1, "to": 2, "jam": {"every_s": 0.1}}]})
assert scenario.link_settings(1, 2).jam.every_s == 0.1
assert loads(dumps(scenario)) == scenario
try:
    loads(text, "f", {"network.default.jam.evry_s": 0.5})
except ScenarioError as error:
    assert "did you mean 'every_s'" in str(error)
else:
    raise AssertionError("a wrong key was taken")
"""


@pytest.mark.processes
def test_a_new_impairment_is_one_file(root, tmp_path):
    """In a copy of the packages, interpreted: the file alone makes it a setting of every link."""
    for name in ("agent", "configs", "exact", "formation", "lab", "netem", "plant"):
        ignored = shutil.ignore_patterns("*.so", "__pycache__")
        shutil.copytree(root / name, tmp_path / "formnet" / name, ignore=ignored)
    shutil.copy(root / "formnet" / "__init__.py", tmp_path / "formnet")
    (tmp_path / "formnet" / "netem" / "impairments" / "jam.py").write_text(JAM, encoding="utf-8")
    program = Path(tmp_path / "program.py")
    program.write_text(PROGRAM, encoding="utf-8")
    done = subprocess.run([sys.executable, program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
