"""Who does the work of a campaign: this process, local processes, or a Dask cluster.

All give the finished designs one by one, as plain JSON objects, in any order.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from functools import partial
from typing import Any

from kiribench.errors import NotConvergedError, UsageError
from kiribench.fem.campaign_piece import simulate_design
from kiribench.fem.campaign_settings import CampaignSettings, Design
from kiribench.processes import in_processes

Pieces = Generator[dict[str, Any], None, None]


def run_here(settings: CampaignSettings, designs: Sequence[Design]) -> Pieces:
    """One design after another in this process."""
    for design in designs:
        yield simulate_design(settings, design)


def run_processes(settings: CampaignSettings, designs: Sequence[Design], jobs: int) -> Pieces:
    """``jobs`` local processes, one thread each.

    Raises:
        NotConvergedError: the system ended a worker, for want of memory most likely.
    """
    _compile(settings)
    yield from in_processes(partial(simulate_design, settings), designs, jobs)


def _compile(settings: CampaignSettings) -> None:
    """Fill the cache of compiled kernels once, before every worker would do it."""
    first = CampaignSettings(
        settings.model,
        (1.01,) if settings.model == "cell" else (0.1,),
        settings.mesh_mm,
        mesh_error_limit=None,
    )
    simulate_design(first, Design(50.0, 50.0))


def run_cluster(settings: CampaignSettings, designs: Sequence[Design], address: str) -> Pieces:
    """The workers of the Dask scheduler at ``address`` (``tcp://host:8786``).

    The scheduler gives a design to another worker where its worker is lost.

    Raises:
        UsageError: dask.distributed is not installed, or nobody answers at the address.
        NotConvergedError: a design ended several workers.
    """
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError as error:
        raise UsageError(
            "dask-missing",
            "--scheduler needs dask.distributed.",
            remedy="Install kiribench with the extra 'cluster'.",
        ) from error
    try:
        client = Client(address, timeout="20s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(
            "scheduler-unreachable",
            f"No Dask scheduler answers ({type(error).__name__}).",
            remedy="Start 'dask scheduler' and check host, port and firewall.",
            got=address,
            expected="an address such as tcp://host:8786",
        ) from error
    with client:
        futures = [
            client.submit(simulate_design, settings, design, pure=False) for design in designs
        ]
        try:
            for future in as_completed(futures, loop=client.loop):
                yield future.result()
                future.release()
        except KilledWorker as error:
            raise NotConvergedError(
                "worker-ended",
                "A design ended several workers of the cluster, for want of memory most likely.",
                remedy="Give the workers more memory and start again; finished designs are kept.",
                got=str(error),
            ) from error
