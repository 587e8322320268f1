"""Work for the pool: what another process does must be imported there by its name."""

import os
import signal
import time


def squared(item, stopped):
    return item * item


def until_stopped(item, stopped):
    if item == 0:
        return "first"
    while not stopped():
        pass
    return "stopped"


class Unpicklable(Exception):
    def __init__(self, one, two):
        super().__init__(one)


def endless(begun, stopped):
    begun.touch()
    time.sleep(600.0)


def failing(item, stopped):
    raise Unpicklable("three is", "not good")


def dying(item, stopped):
    os.kill(os.getpid(), signal.SIGKILL)
