"""An SSH server for tests: runs what it is asked to, for whoever has the key.

``python sshd.py ADDRESS PORT HOST_KEY AUTHORIZED_KEYS``
"""

import asyncio
import sys

import asyncssh


async def handle(process):
    child = await asyncio.create_subprocess_shell(
        process.command,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    await process.redirect(stdin=child.stdin, stdout=child.stdout, stderr=child.stderr)
    code = await child.wait()
    if code < 0:
        process.exit_with_signal("KILL")
    else:
        process.exit(code)


async def main(address, port, host_key, authorized):
    server = await asyncssh.listen(
        address,
        int(port),
        server_host_keys=[host_key],
        authorized_client_keys=authorized,
        process_factory=handle,
        encoding=None,
    )
    print("listening", flush=True)
    await server.wait_closed()


asyncio.run(main(*sys.argv[1:]))
