"""Without keys anybody on loopback may put anything on the bus: odd names are nobody's."""

import pytest
from processes import until

from formnet.formation.wire import bus
from formnet.formation.wire.messages import Join, encode
from formnet.formation.wire.plant_bus import ZenohPlantBus
from formnet.lab.launch.launch import free_port

ODD = ["3 ", " 3", "٣", "03", "+3", "3_0", "-3", "3.0", "x", "", "30", "³"]


@pytest.mark.processes
def test_odd_names_are_no_robot_s_and_raise_nowhere(capfd):
    endpoint, keys = f"tcp/127.0.0.1:{free_port()}", bus.Keys("run")
    told, heard = [], []
    with bus.session(listen=endpoint) as hub:
        plant = ZenohPlantBus(hub, "run", blocking=True)
        plant.listen(
            [3, 30],
            lambda robot, message: heard.append((robot, message)),
            lambda robot, reason: heard.append((robot, reason)),
            lambda robot, here: told.append((robot, here)),
        )
        with bus.session(connect=endpoint) as stranger, bus.session(connect=endpoint) as genuine:
            alive = genuine.liveliness().declare_token(keys.robot_alive(3))
            until(lambda: told == [(3, True)])
            names = [name for name in ODD if name not in ("", "30")]
            tokens = [
                stranger.liveliness().declare_token(f"formnet/run/alive/robot/{name}")
                for name in names
            ]
            for name in names:
                stranger.put(f"formnet/run/from-robot/{name}", encode(Join(3, 1)))
            last = stranger.liveliness().declare_token(keys.robot_alive(30))
            until(lambda: (30, True) in told)
            for token in [*tokens, last]:
                token.undeclare()
            until(lambda: (30, False) in told)
            assert told == [(3, True), (30, True), (30, False)]
            assert heard == []
            alive.undeclare()
            until(lambda: told[-1] == (3, False))
    assert "Traceback" not in capfd.readouterr().err
