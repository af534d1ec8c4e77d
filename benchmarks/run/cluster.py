"""Run parts on a Dask cluster."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import urlsplit

from benchmarks.blocks.base import Kind
from benchmarks.run.work import Failure, Outcome, attempt
from optik.errors import InvalidInput, MissingDependency, OptikError

CONNECT_SECONDS = 5.0
"""Time limit for a scheduler to answer and to have a worker [s]: short, to report a wrong address soon."""

PARTS_A_THREAD = 2
"""Parts per thread of the cluster: one that runs, and one that waits there."""


class ClusterLost(OptikError, RuntimeError):
    """The loss of a cluster during a run."""


class OnDask:
    """A Dask cluster."""

    def __init__(self, address: str, recorded: Sequence[Mapping[str, str]]) -> None:
        try:
            import distributed as dask
        except ImportError:
            raise MissingDependency("distributed", "--dask", "distributed") from None
        self._recorded, self._address = list(recorded), address
        self._tickets: dict[Any, int] = {}
        self._dask: Any = dask
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # losing a worker is not an error of the run
        self._client = self._connected(address)
        threads = sum(worker["nthreads"] for worker in self._client.scheduler_info(n_workers=-1)["workers"].values())
        self.room = PARTS_A_THREAD * max(threads, 1)

    def _connected(self, address: str) -> Any:
        """Return a client of a scheduler with workers."""
        try:
            security = self._dask.Security() if address.startswith("tls://") else None
            arguments = security.get_connection_args("client") if security else {}
            if security and arguments.get("ssl_context") is None:
                raise ValueError("Dask's configuration, distributed.comm.tls, names no certificates")
            asyncio.run(self._greeted(address, arguments))  # a client that cannot connect closes slowly
        except Exception as error:  # any kind of server may answer
            raise _not_usable(address, _first_line(error)) from None
        client = self._dask.Client(address, timeout=CONNECT_SECONDS, security=security, set_as_default=False)
        try:
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        except TimeoutError:
            client.close(timeout=CONNECT_SECONDS)
            raise _not_usable(address, "it has no workers") from None
        return client

    async def _greeted(self, address: str, arguments: dict[str, Any]) -> None:
        """Connect once, with Dask's handshake."""
        comm = await self._dask.comm.connect(address, timeout=CONNECT_SECONDS, **arguments)
        comm.abort()

    def submit(self, ticket: int, kind: Kind, work: Any) -> None:
        """Submit work."""
        future = self._client.submit(attempt, kind, work, self._recorded, pure=False)
        self._tickets[future] = ticket

    def wait(self) -> Sequence[tuple[int, Outcome]]:
        """Wait for outcomes."""
        try:
            with self._client.as_current():
                done = self._dask.wait(list(self._tickets), return_when="FIRST_COMPLETED").done
            return [(self._tickets.pop(future), self._outcome(future)) for future in done]
        except (OSError, self._dask.CancelledError, TimeoutError) as error:
            words = f"lost the Dask scheduler at {self._address} ({_first_line(error)})"
            raise ClusterLost(f"{words}; finished parts are kept: repeat the command to resume") from None

    def _outcome(self, future: Any) -> Outcome:
        """Return the outcome of a finished future."""
        if future.status == "cancelled":
            raise self._dask.CancelledError(self._address)
        if future.status == "finished":
            return future.result()  # type: ignore[no-any-return]
        error = future.exception()
        if isinstance(error, self._dask.KilledWorker):
            return Failure("every worker of the cluster that ran it ended", again=True)
        raise ClusterLost(f"a Dask worker failed: {_first_line(error)}; is optik installed on the worker?")

    def close(self) -> None:
        """Cancel unfinished work and disconnect."""
        for future in self._tickets:
            future.release()
        self._client.close(timeout=CONNECT_SECONDS)


def _not_usable(address: str, why: str) -> InvalidInput:
    return InvalidInput("--dask", f"{address!r} ({why})", "the address of a running Dask scheduler with a worker")


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
