"""The worlds of PyBullet that are open in a process."""


def pybullet_clients() -> set[int]:
    """The numbers of the worlds of PyBullet that are open in this process."""
    import pybullet

    return {number for number in range(1024) if pybullet.getConnectionInfo(number)["isConnected"]}
