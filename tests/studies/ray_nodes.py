"""Ray nodes on this machine that listen only on the loopback interface, and are ended by the test that starts them."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

# Ray reads this when it is imported; otherwise it replaces 127.0.0.1 by the machine's address in its network.
os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"

_NODE: dict[str, Any] = {
    "num_cpus": 1,
    "node_ip_address": "127.0.0.1",
    "object_store_memory": 80 << 20,
    "include_log_monitor": False,
}


class RayNodes:
    """A cluster of nodes with one processor each.

    Attributes:
        address: Its address.
        folder: The temporary folder of its nodes.
    """

    def __init__(self, cluster: Any, folder: Path) -> None:
        self._cluster = cluster
        self.folder = folder
        self.address: str = cluster.address

    def add(self, **variables: str) -> Any:
        """Start another node, with further environment variables."""
        return _added(self._cluster, env_vars={"TMPDIR": str(self.folder), **variables})

    def kill(self, node: Any) -> None:
        """End all processes of a node at once."""
        self._cluster.remove_node(node, allow_graceful=False)


@contextmanager
def ray_nodes() -> Iterator[RayNodes]:
    """Start a node, and end all nodes afterwards."""
    from ray.cluster_utils import Cluster

    with tempfile.TemporaryDirectory(prefix="ray", ignore_cleanup_errors=True) as folder:
        cluster = Cluster()
        try:
            _added(cluster, include_dashboard=False, temp_dir=folder, env_vars={"TMPDIR": folder})
            yield RayNodes(cluster, Path(folder))
        finally:
            cluster.shutdown()


def _added(cluster: Any, **options: Any) -> Any:
    """Start a node; Ray gives up after half a minute, which may be too soon on a busy machine."""
    for _ in range(5):
        with suppress(Exception):
            return cluster.add_node(**_NODE, **options)
    return cluster.add_node(**_NODE, **options)
