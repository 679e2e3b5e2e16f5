"""Cannot be imported without the extra `pybullet`."""

import pybullet  # noqa: F401
