"""What a plant needs of a bus, and how Zenoh gives it.

Tests have one in memory (``tests/helpers/memory_bus.py``): what can go wrong between a plant and
its robots is a matter of function calls.
"""

from collections.abc import Callable, Iterable
from typing import Any, Protocol

import zenoh

from formnet.formation.wire import bus
from formnet.formation.wire.message_error import MessageError
from formnet.formation.wire.messages import Message, decode

Receive = Callable[[int, Message], None]
"""Takes a message and the robot whose key it came on."""


class PlantBus(Protocol):
    """A plant's side of the bus of one run. Handlers may be called on any thread, one at a time
    for each of them."""

    def sender(self, robot: int) -> Callable[[bytes], None]:
        """What sends ``robot`` a message (:func:`formation.wire.messages.encode`)."""

    def listen(
        self,
        robots: Iterable[int],
        receive: Receive,
        refuse: Callable[[int, str], None],
        connected: Callable[[int, bool], None],
    ) -> None:
        """Announce the plant, and hear ``robots`` from now on.

        What does not decode goes to ``refuse`` (robot, reason). ``connected`` is told of each
        robot that is there, now or later, and when it is gone.
        """

    def overhear(self, source: int, receive: Callable[[bytes], None]) -> None:
        """Hear the envelopes of what robot ``source`` broadcasts; empty where there is none."""


class ZenohPlantBus:
    """A :class:`PlantBus` of run ``run`` over Zenoh.

    ``blocking``: where the network is full, senders wait until robots have taken what is for them;
    otherwise it is dropped.
    """

    def __init__(self, session: zenoh.Session, run: str, *, blocking: bool) -> None:
        self._session = session
        self._keys = bus.Keys(run)
        self._blocking = blocking
        self._declared: list[Any] = []  # Zenoh undeclares what nobody holds

    def sender(self, robot: int) -> Callable[[bytes], None]:
        """See :class:`PlantBus`."""
        key = self._keys.to_robot(robot)
        publisher = bus.publisher(self._session, key, blocking=self._blocking)
        put: Callable[[bytes], None] = publisher.put
        return put

    def listen(
        self,
        robots: Iterable[int],
        receive: Receive,
        refuse: Callable[[int, str], None],
        connected: Callable[[int, bool], None],
    ) -> None:
        """See :class:`PlantBus`. What comes on a key that is not exactly one of theirs is ignored.

        (Anybody may put on ``.../from-robot/03``, and be alive as that, where there are no keys.)
        """
        senders: dict[str, int] = {}
        tokens: dict[str, int] = {}
        for robot in robots:
            senders[self._keys.from_robot(robot)] = tokens[self._keys.robot_alive(robot)] = robot

        def on_message(sample: zenoh.Sample) -> None:
            robot = senders.get(str(sample.key_expr))
            if robot is None:
                return
            try:
                message = decode(sample.payload.to_bytes())
            except MessageError as error:
                refuse(robot, str(error))
            else:
                receive(robot, message)

        def on_liveliness(sample: zenoh.Sample) -> None:
            robot = tokens.get(str(sample.key_expr))
            if robot is not None:
                connected(robot, sample.kind != zenoh.SampleKind.DELETE)

        alive = self._session.liveliness()
        self._declared += [
            alive.declare_token(self._keys.plant_alive),
            alive.declare_subscriber(self._keys.robots_alive, on_liveliness, history=True),
            self._session.declare_subscriber(self._keys.from_robots, on_message),
        ]

    def overhear(self, source: int, receive: Callable[[bytes], None]) -> None:
        """See :class:`PlantBus`."""

        def on_broadcast(sample: zenoh.Sample) -> None:
            attachment = sample.attachment
            receive(b"" if attachment is None else attachment.to_bytes())

        key = self._keys.broadcast(source)
        self._declared.append(self._session.declare_subscriber(key, on_broadcast))
