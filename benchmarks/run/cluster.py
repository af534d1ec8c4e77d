"""Dask clusters as pools."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError, Future
from typing import Any
from urllib.parse import urlsplit

from benchmarks.run.pool import Failure, Pool, PoolLost
from optik.errors import InvalidInput, MissingDependency

CONNECT_SECONDS = 5.0
"""Time limit for a scheduler to answer and to have a worker [s]: short, to report a wrong address soon."""

PARTS_A_THREAD = 2
"""Parts per thread of the cluster: one that runs, and one that waits there."""


class Cluster(Pool):
    """A Dask cluster."""

    def __init__(self, address: str, recorded: Sequence[Mapping[str, str]]) -> None:
        try:
            import distributed
        except ImportError:
            raise MissingDependency("distributed", "--dask", "distributed") from None
        for name in ("distributed", "distributed.client"):  # losing a worker is not an error of the run
            logging.getLogger(name).setLevel(logging.CRITICAL)
        self._address, self._dask = address, distributed
        self._client = self._connected()
        threads = sum(worker["nthreads"] for worker in self._client.scheduler_info(n_workers=-1)["workers"].values())
        super().__init__(self._client.get_executor(pure=False), PARTS_A_THREAD * max(threads, 1), recorded)

    def _connected(self) -> Any:
        """Return a client of a scheduler with workers."""
        try:
            security = self._dask.Security() if self._address.startswith("tls://") else None
            arguments = security.get_connection_args("client") if security else {}
            if security and arguments.get("ssl_context") is None:
                raise ValueError("Dask's configuration, distributed.comm.tls, names no certificates")
            asyncio.run(self._greeted(arguments))  # a client that cannot connect closes slowly
        except Exception as error:  # any kind of server may answer
            raise self._unusable(_first_line(error)) from None
        client = self._dask.Client(self._address, timeout=CONNECT_SECONDS, security=security, set_as_default=False)
        try:
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        except TimeoutError:
            client.close(timeout=CONNECT_SECONDS)
            raise self._unusable("it has no workers") from None
        return client

    async def _greeted(self, arguments: dict[str, Any]) -> None:
        """Connect once, with Dask's handshake."""
        comm = await self._dask.comm.connect(self._address, timeout=CONNECT_SECONDS, **arguments)
        comm.abort()

    def _unusable(self, why: str) -> InvalidInput:
        expected = "the address of a running Dask scheduler with a worker"
        return InvalidInput("--dask", f"{self._address!r} ({why})", expected)

    def outcome(self, future: Future[Any]) -> Any:
        """Return the result of work, or its `Failure`; raise its OptikError."""
        try:
            error = future.exception()
        except CancelledError:
            words = (
                f"lost the Dask scheduler at {self._address}; finished parts are stored: repeat the command to resume"
            )
            raise PoolLost(words) from None
        if isinstance(error, self._dask.KilledWorker):
            return Failure("every worker of the cluster that ran it ended", again=True)
        if error is not None:
            raise PoolLost(f"a Dask worker failed: {_first_line(error)}; is optik installed on the worker?")
        return super().outcome(future)

    def close(self) -> None:
        """Cancel unfinished work and disconnect."""
        super().close()
        self._client.close(timeout=CONNECT_SECONDS)


def _first_line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]


def warn_of_plain_text(address: str) -> str:
    """Return a warning for an address with unencrypted traffic to another machine; empty for any other."""
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    if parts.scheme in ("tls", "wss", "inproc") or _is_loopback(parts.hostname or ""):
        return ""
    return (
        f"{address}: plain TCP to another machine. Anyone who can reach it can read the work, and run code on the workers and "
        "on this machine. On a shared network, use tls://"
    )


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
