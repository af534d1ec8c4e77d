"""A Dask cluster as a place for work."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import urlsplit

from benchmarks.run.work import Failure, Outcome, attempt
from optik.errors import InvalidInput, MissingDependency, OptikError

CONNECT_SECONDS = 5.0
"""Within which a scheduler must answer and have a worker [s]: a wrong address shows at once, not after a minute."""

PARTS_A_THREAD = 2
"""Parts that a thread of the cluster has at a time: one in hand, and one that has arrived already."""


class ClusterLost(OptikError, RuntimeError):
    """A cluster that ended while it had work."""


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
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the loss of a worker is no error here
        self._client = self._connected(address)
        threads = sum(worker["nthreads"] for worker in self._client.scheduler_info(n_workers=-1)["workers"].values())
        self.room = PARTS_A_THREAD * max(threads, 1)

    def _connected(self, address: str) -> Any:
        """A client of a scheduler that has workers."""
        try:
            security = self._dask.Security() if address.startswith("tls://") else None
            arguments = security.get_connection_args("client") if security else {}
            if security and arguments.get("ssl_context") is None:
                raise ValueError("Dask's configuration, distributed.comm.tls, names no certificates")
            asyncio.run(self._greeted(address, arguments))  # a client that cannot connect takes long to end
        except Exception as error:  # what answers there may be anything
            raise _not_usable(address, _first_line(error)) from None
        client = self._dask.Client(address, timeout=CONNECT_SECONDS, security=security, set_as_default=False)
        try:
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        except TimeoutError:
            client.close(timeout=CONNECT_SECONDS)
            raise _not_usable(address, "it has no workers") from None
        return client

    async def _greeted(self, address: str, arguments: dict[str, Any]) -> None:
        """Connect once, with the greeting of Dask."""
        comm = await self._dask.comm.connect(address, timeout=CONNECT_SECONDS, **arguments)
        comm.abort()

    def submit(self, ticket: int, kind: str, work: Any) -> None:
        """Submit a piece of work."""
        future = self._client.submit(attempt, kind, work, self._recorded, pure=False)
        self._tickets[future] = ticket

    def wait(self) -> Sequence[tuple[int, Outcome]]:
        """Wait for outcomes."""
        try:
            with self._client.as_current():
                done = self._dask.wait(list(self._tickets), return_when="FIRST_COMPLETED").done
            return [(self._tickets.pop(future), self._outcome(future)) for future in done]
        except (OSError, self._dask.CancelledError, TimeoutError) as error:
            words = f"the Dask scheduler at {self._address} is gone ({_first_line(error)})"
            raise ClusterLost(f"{words}; what was done is kept: run the same command again") from None

    def _outcome(self, future: Any) -> Outcome:
        """Outcome of a future that is done."""
        if future.status == "cancelled":
            raise self._dask.CancelledError(self._address)
        if future.status == "finished":
            return future.result()  # type: ignore[no-any-return]
        error = future.exception()
        if isinstance(error, self._dask.KilledWorker):
            return Failure("every worker of the cluster that had it ended", again=True)
        raise ClusterLost(f"a Dask worker could not do its work: {_first_line(error)}; is optik installed there?")

    def close(self) -> None:
        """Take back what is not done, and leave the cluster."""
        for future in self._tickets:
            future.release()
        self._client.close(timeout=CONNECT_SECONDS)


def _not_usable(address: str, why: str) -> InvalidInput:
    return InvalidInput("--dask", f"{address!r} ({why})", "a Dask scheduler that answers, and that has a worker")


def _first_line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]


def warn_of_plain_text(address: str) -> str:
    """What to say of an address whose traffic anyone on the network may read and change."""
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    if parts.scheme in ("tls", "wss", "inproc") or _is_loopback(parts.hostname or ""):
        return ""
    return (
        f"{address}: plain TCP to another machine; who can reach it can read the work, and run code in the workers and "
        "here. Use tls:// on a network that you share"
    )


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
