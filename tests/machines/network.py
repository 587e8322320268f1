"""Three network namespaces with an SSH server in each."""

import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import asyncssh

HOSTS = {"alpha": [1, 2], "beta": [3, 4], "gamma": [5]}
PORT = 2222


def ip(*words):
    subprocess.run(["ip", *words], check=True, capture_output=True)


class Network:
    """Namespaces on a bridge; ours has address .254, host k has .k."""

    def __init__(self, folder):
        self.folder = folder
        self.prefix = f"f{os.getpid() % 100000}"
        self.subnet = f"10.{50 + os.getpid() % 150}.77"
        self.servers = {}

    def name(self, host):
        return f"{self.prefix}{host[0]}"

    def address(self, host):
        return f"{self.subnet}.{1 + list(HOSTS).index(host)}"

    @property
    def here(self):
        return f"{self.subnet}.254"

    def build(self):
        bridge = f"{self.prefix}br"
        ip("link", "add", bridge, "type", "bridge")
        ip("addr", "add", f"{self.here}/24", "dev", bridge)
        ip("link", "set", bridge, "up")
        for host in HOSTS:
            name = self.name(host)
            ip("netns", "add", name)
            ip("link", "add", f"{name}0", "type", "veth", "peer", "name", "eth0", "netns", name)
            ip("link", "set", f"{name}0", "master", bridge)
            ip("link", "set", f"{name}0", "up")
            ip("-n", name, "addr", "add", f"{self.address(host)}/24", "dev", "eth0")
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "set", "eth0", "up")

    def serve(self):
        home = self.folder / "home" / ".ssh"
        home.mkdir(parents=True)
        client, host_key = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
        client.write_private_key(home / "id_ed25519")
        client.write_public_key(self.folder / "authorized")
        host_key.write_private_key(self.folder / "host-key")
        public = host_key.export_public_key().decode().strip()
        known = [f"[{self.address(host)}]:{PORT} {public}" for host in HOSTS]
        (home / "known_hosts").write_text("\n".join(known) + "\n")
        for host in HOSTS:
            self.servers[host] = subprocess.Popen(
                [
                    "ip",
                    "netns",
                    "exec",
                    self.name(host),
                    sys.executable,
                    str(Path(__file__).parents[1] / "helpers" / "sshd.py"),
                    self.address(host),
                    str(PORT),
                    str(self.folder / "host-key"),
                    str(self.folder / "authorized"),
                ],
                stdout=subprocess.PIPE,
                text=True,
            )
        for host, server in self.servers.items():
            assert server.stdout.readline() == "listening\n", host

    def tear_down(self):
        for server in self.servers.values():
            server.kill()
            server.wait()
        for host in HOSTS:
            subprocess.run(["ip", "netns", "del", self.name(host)], capture_output=True)
        subprocess.run(["ip", "link", "del", f"{self.prefix}br"], capture_output=True)

    @contextmanager
    def down(self, host):
        ip("link", "set", f"{self.name(host)}0", "down")
        yield
        ip("link", "set", f"{self.name(host)}0", "up")
