"""Another user of the machine, or another program of the same one, who tries what dask lets anyone do without keys.

python -m tests.viz.stranger UID < where.json      UID: an empty word to stay who one is
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from http.client import HTTPException
from typing import Any
from urllib.request import urlopen

from distributed import Client, Security, rpc

PAGES = ("/", "/status", "/health", "/metrics", "/json/counts.json", "/info/main/workers.html")
KEYS = ("tls_ca_file", "tls_client_cert", "tls_client_key")
TRIES_S = 3.0
WITH_KEYS_S = 60.0


async def task(address: str, security: Security, most_s: float = TRIES_S) -> int | None:
    """The user as whom a task runs there; None where none does."""
    try:
        async with (
            asyncio.timeout(2.0 * most_s),
            Client(address, security=security, timeout=most_s, asynchronous=True, set_as_default=False) as client,
        ):
            return int(await client.submit(os.getuid, pure=False))
    except Exception:
        return None


async def answers(address: str, security: Security) -> bool:
    """Whether one of dask's servers, of scheduler, worker or guard, says there who it is."""
    server = rpc(address, connection_args=security.get_connection_args("client"), timeout=TRIES_S)
    try:
        async with asyncio.timeout(TRIES_S):
            return bool(await server.identity())
    except Exception:
        return False
    finally:
        await server.close_rpc()


def page(port: int, path: str) -> bool:
    """Whether there is something to read."""
    try:
        with urlopen(f"http://127.0.0.1:{port}{path}", timeout=TRIES_S):
            return True
    except (OSError, HTTPException):
        return False


async def tried(where: dict[str, Any]) -> dict[str, Any]:
    """What comes of a task and of a question, in plain and with one's own keys; of pages; and of a task with theirs."""
    scheduler, ports = where["scheduler"].partition("://")[2], where["ports"]
    ways = {"tcp": Security(require_encryption=False), "tls": Security.temporary()}
    tasks = [task(f"{scheme}://{scheduler}", keys) for scheme, keys in ways.items()]
    asked = [answers(f"{scheme}://127.0.0.1:{port}", keys) for scheme, keys in ways.items() for port in ports]
    theirs = Security(require_encryption=True, **{name: where[name] for name in KEYS})
    return {
        "tasks": await asyncio.gather(*tasks),
        "answers": sum(await asyncio.gather(*asked)),
        "pages": [path for port in ports for path in PAGES if page(port, path)],
        "with keys": await task(f"tls://{scheduler}", theirs, WITH_KEYS_S),
    }


if __name__ == "__main__":
    where = json.load(sys.stdin)
    if sys.argv[1]:
        os.setgroups([])
        os.setuid(int(sys.argv[1]))
    print(json.dumps(asyncio.run(tried(where))))
