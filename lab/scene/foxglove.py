"""A run as MCAP, JSON-encoded, with the message types that Foxglove shows without being told.

====================  ========================  ==============================================
topic                 schema                    holds
====================  ========================  ==============================================
/tf                   foxglove.FrameTransforms  where the robots are: frames ``robot_1`` ...
/scene                foxglove.SceneUpdate      what they look like; the graph's edges
/robot_1/pose ...     foxglove.PoseInFrame      the pose
/robot_1/state ...    formnet.State             a row of states.parquet
/errors               formnet.Errors            Eqs. 3-5, of the robots that are up at the end
/lyapunov             formnet.Lyapunov          V
/links/1_to_2 ...     formnet.Delivery          a row of links.parquet
/events               foxglove.Log              a line of events.jsonl
====================  ========================  ==============================================

Log times are simulated time (for a message on a link: when it could be used, or, lost, when it
was sent; its publish time is when it was sent). Numbers that are not finite are null.
"""

import json
import math
from collections.abc import Iterator
from heapq import merge
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.writer import Writer

from formnet.formation.records.events import Severity
from formnet.formation.records.rows import LinkRow, Sample
from formnet.lab.figures.canvas import SCREEN_COLOURS, colours
from formnet.lab.judge import lyapunov
from formnet.lab.judge.errors import error_series
from formnet.lab.runs.build import versions
from formnet.lab.verdict.recorded import Recorded

_WORLD = "world"
_SCENE_EVERY_NS = 40_000_000
"""How often the graph's edges are drawn anew."""
_LEVELS = {Severity.DEBUG: 1, Severity.INFO: 2, Severity.WARNING: 3, Severity.ERROR: 4}
"""As ``foxglove.Log`` numbers them."""

Schema = dict[str, Any]


class Message(NamedTuple):
    """One message of the file: ``t_ns`` is its log time; it sorts by that."""

    t_ns: int
    topic: str
    schema: str
    data: dict[str, Any]
    published_ns: int


def write(run: Recorded, stream: IO[bytes]) -> None:
    """Write all that is recorded of ``run``."""
    writer = Writer(stream)
    writer.start(profile="", library="formnet")
    writer.add_metadata(
        "formnet",
        {
            "scenario": run.scenario.name,
            "seed": str(run.scenario.seed),
            "sha256": "" if run.verdict is None else run.verdict.trajectory_sha256,
            "formnet": str(versions()["formnet"]),
        },
    )
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    counts: dict[str, int] = {}
    for message in messages(run):
        if message.topic not in channels:
            if message.schema not in schemas:
                text = json.dumps(SCHEMAS[message.schema]).encode()
                schemas[message.schema] = writer.register_schema(message.schema, "jsonschema", text)
            channels[message.topic] = writer.register_channel(
                message.topic, "json", schemas[message.schema]
            )
        counts[message.topic] = counts.get(message.topic, -1) + 1
        writer.add_message(
            channels[message.topic],
            message.t_ns,
            json.dumps(message.data).encode(),
            message.published_ns,
            counts[message.topic],
        )
    writer.finish()  # type: ignore[no-untyped-call]


def messages(run: Recorded) -> Iterator[Message]:
    """Every message, in the order of their log times."""
    links = sorted(_deliveries(run), key=lambda message: message.t_ns)
    return merge(_motion(run), _measures(run), links, _events(run), key=lambda found: found.t_ns)


def _motion(run: Recorded) -> Iterator[Message]:
    if not run.samples:
        return
    yield _message(0, "/scene", "foxglove.SceneUpdate", _bodies(run))
    drawn_ns = -_SCENE_EVERY_NS
    robots = len(run.scenario.ids)
    for start in range(0, len(run.samples), robots):
        rows = run.samples[start : start + robots]
        t_ns = rows[0].t_ns
        placed = [row for row in rows if all(map(math.isfinite, row[2:5]))]
        yield _message(
            t_ns,
            "/tf",
            "foxglove.FrameTransforms",
            {"transforms": [_transform(row) for row in placed]},
        )
        for row in rows:
            data = {name: _number(value) for name, value in row._asdict().items()}
            yield _message(t_ns, f"/robot_{row.robot}/state", "formnet.State", data)
        for row in placed:
            yield _message(
                t_ns,
                f"/robot_{row.robot}/pose",
                "foxglove.PoseInFrame",
                {
                    "timestamp": _time(t_ns),
                    "frame_id": _WORLD,
                    "pose": {"position": _place(row), "orientation": _turned(row.heading_rad)},
                },
            )
        if t_ns - drawn_ns >= _SCENE_EVERY_NS:
            drawn_ns = t_ns
            yield _message(t_ns, "/scene", "foxglove.SceneUpdate", _graph(run, t_ns, placed))


def _measures(run: Recorded) -> Iterator[Message]:
    trajectories = run.trajectories
    if not len(trajectories.t_ns):
        return
    up = run.up_at(int(trajectories.t_ns[-1]))
    series = error_series(run.scenario, trajectories, up)
    found = lyapunov.curve(run)
    v = None if found is None else dict(zip((found.t_s * 1e9).round(), found.v, strict=True))
    for t_ns, *errors in zip(
        trajectories.t_ns.tolist(), *(s.tolist() for s in series), strict=True
    ):
        data = dict(zip(series._fields, map(_number, errors), strict=True))
        yield _message(t_ns, "/errors", "formnet.Errors", data)
        if v is not None and t_ns in v:
            yield _message(t_ns, "/lyapunov", "formnet.Lyapunov", {"v": _number(float(v[t_ns]))})


def _deliveries(run: Recorded) -> Iterator[Message]:
    for row in run.link_rows:
        topic = f"/links/{row.source}_to_{row.destination}"
        t_ns = row.t_sent_ns if row.t_usable_ns is None else row.t_usable_ns
        yield Message(t_ns, topic, "formnet.Delivery", _delivery(row), row.t_sent_ns)


def _events(run: Recorded) -> Iterator[Message]:
    for event in run.told:
        yield _message(
            event.t_ns,
            "/events",
            "foxglove.Log",
            {
                "timestamp": _time(event.t_ns),
                "level": _LEVELS[event.severity],
                "name": event.name,
                "message": f"{event.name} {json.dumps(event.details, ensure_ascii=False)}",
                "file": "",
                "line": 0,
            },
        )


def _message(t_ns: int, topic: str, schema: str, data: dict[str, Any]) -> Message:
    return Message(t_ns, topic, schema, data, t_ns)


def _bodies(run: Recorded) -> dict[str, Any]:
    """A body, a nose and a number for every robot, each fixed to the robot's own frame."""
    size = max(0.02 * float(np.ptp(run.scenario.offsets_m, axis=0).max()), 0.1)
    entities = []
    own = colours(len(run.scenario.ids), SCREEN_COLOURS)
    for robot, code in zip(run.scenario.ids, own, strict=True):
        colour = _colour(code)
        entities.append(
            _entity(f"robot_{robot}", f"robot_{robot}", 0)
            | {
                "frame_locked": True,
                "cylinders": [
                    {
                        "pose": _pose(0.0, 0.0, 0.25 * size),
                        "color": colour,
                        "size": {"x": 2 * size, "y": 2 * size, "z": 0.5 * size},
                        "bottom_scale": 1.0,
                        "top_scale": 1.0,
                    }
                ],
                "arrows": [
                    {
                        "pose": _pose(0.0, 0.0, 0.6 * size),
                        "color": colour,
                        "shaft_length": 2 * size,
                        "shaft_diameter": 0.3 * size,
                        "head_length": size,
                        "head_diameter": 0.8 * size,
                    }
                ],
                "texts": [
                    {
                        "pose": _pose(0.0, 0.0, 1.5 * size),
                        "billboard": True,
                        "font_size": size,
                        "scale_invariant": False,
                        "color": colour,
                        "text": str(robot),
                    }
                ],
            }
        )
    return {"deletions": [], "entities": entities}


def _graph(run: Recorded, t_ns: int, rows: list[Sample]) -> dict[str, Any]:
    """The edges of the graph between robots where they are."""
    at = {row.robot: _place(row) for row in rows}
    points = [
        at[end]
        for edge in run.scenario.formation.edges
        if edge[0] in at and edge[1] in at
        for end in edge
    ]
    lines = {
        "type": 2,
        "pose": _pose(0.0, 0.0, 0.0),
        "thickness": 2.0,
        "scale_invariant": True,
        "points": points,
        "color": _colour("#888888"),
        "colors": [],
        "indices": [],
    }
    return {"deletions": [], "entities": [_entity("graph", _WORLD, t_ns) | {"lines": [lines]}]}


def _entity(name: str, frame: str, t_ns: int) -> dict[str, Any]:
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": _time(t_ns),
        "frame_id": frame,
        "id": name,
        "lifetime": _time(0),
        "frame_locked": False,
        "metadata": [],
        **{kind: [] for kind in kinds},
    }


def _transform(row: Sample) -> dict[str, Any]:
    return {
        "timestamp": _time(row.t_ns),
        "parent_frame_id": _WORLD,
        "child_frame_id": f"robot_{row.robot}",
        "translation": _place(row),
        "rotation": _turned(row.heading_rad),
    }


def _delivery(row: LinkRow) -> dict[str, Any]:
    delay_s = None if row.t_usable_ns is None else (row.t_usable_ns - row.t_sent_ns) / 1e9
    return row._asdict() | {"delay_s": delay_s}


def _place(row: Sample) -> dict[str, float]:
    return {"x": row.x_m, "y": row.y_m, "z": 0.0}


def _turned(heading_rad: float) -> dict[str, float]:
    """The quaternion of a turn about the vertical."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(heading_rad / 2), "w": math.cos(heading_rad / 2)}


def _pose(x: float, y: float, z: float) -> dict[str, Any]:
    return {"position": {"x": x, "y": y, "z": z}, "orientation": _turned(0.0)}


def _colour(code: str) -> dict[str, float]:
    red, green, blue = (int(code[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return {"r": red, "g": green, "b": blue, "a": 1.0}


def _time(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // 1_000_000_000, "nsec": t_ns % 1_000_000_000}


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


# --- schemas --------------------------------------------------------------------------


def _object(title: str = "", /, **properties: Schema) -> Schema:
    named = {"title": title} if title else {}
    return {**named, "type": "object", "properties": properties}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_FLOAT, _WHOLE, _TEXT, _FLAG = (
    {"type": kind} for kind in ("number", "integer", "string", "boolean")
)
_TIME = _object("time", sec=_WHOLE, nsec=_WHOLE)
_DURATION = _object("duration", sec=_WHOLE, nsec=_WHOLE)
_VECTOR = _object("foxglove.Vector3", x=_FLOAT, y=_FLOAT, z=_FLOAT)
_POINT = _object("foxglove.Point3", x=_FLOAT, y=_FLOAT, z=_FLOAT)
_QUATERNION = _object("foxglove.Quaternion", x=_FLOAT, y=_FLOAT, z=_FLOAT, w=_FLOAT)
_POSE = _object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOUR = _object("foxglove.Color", r=_FLOAT, g=_FLOAT, b=_FLOAT, a=_FLOAT)
_PRIMITIVES = {
    "arrows": _object(
        pose=_POSE,
        shaft_length=_FLOAT,
        shaft_diameter=_FLOAT,
        head_length=_FLOAT,
        head_diameter=_FLOAT,
        color=_COLOUR,
    ),
    "cylinders": _object(
        pose=_POSE, size=_VECTOR, bottom_scale=_FLOAT, top_scale=_FLOAT, color=_COLOUR
    ),
    "lines": _object(
        type=_WHOLE,
        pose=_POSE,
        thickness=_FLOAT,
        scale_invariant=_FLAG,
        points=_list(_POINT),
        color=_COLOUR,
        colors=_list(_COLOUR),
        indices=_list(_WHOLE),
    ),
    "texts": _object(
        pose=_POSE,
        billboard=_FLAG,
        font_size=_FLOAT,
        scale_invariant=_FLAG,
        color=_COLOUR,
        text=_TEXT,
    ),
}
_ENTITY = _object(
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked=_FLAG,
    metadata=_list(_object(key=_TEXT, value=_TEXT)),
    **{name: _list(kind) for name, kind in _PRIMITIVES.items()},
    **{name: _list(_object()) for name in ("cubes", "spheres", "triangles", "models")},
)
_DELETION = _object(timestamp=_TIME, type=_WHOLE, id=_TEXT)
_TRANSFORM = _object(
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)

SCHEMAS: dict[str, Schema] = {
    "foxglove.FrameTransforms": _object(transforms=_list(_TRANSFORM)),
    "foxglove.SceneUpdate": _object(deletions=_list(_DELETION), entities=_list(_ENTITY)),
    "foxglove.PoseInFrame": _object(timestamp=_TIME, frame_id=_TEXT, pose=_POSE),
    "foxglove.Log": _object(
        timestamp=_TIME, level=_WHOLE, message=_TEXT, name=_TEXT, file=_TEXT, line=_WHOLE
    ),
    "formnet.State": _object(
        t_ns=_WHOLE, robot=_WHOLE, **dict.fromkeys(Sample._fields[2:], _FLOAT)
    ),
    "formnet.Errors": _object(formation_m=_FLOAT, heading_rad=_FLOAT, centroid_m=_FLOAT),
    "formnet.Lyapunov": _object(v=_FLOAT),
    "formnet.Delivery": _object(
        t_sent_ns=_WHOLE,
        t_usable_ns=_WHOLE,
        source=_WHOLE,
        destination=_WHOLE,
        sequence=_WHOLE,
        fate=_TEXT,
        delay_s=_FLOAT,
    ),
}
"""What is in the messages, as far as it is used, by the names that Foxglove knows."""
