"""The `transport` section: read with the scenario, used by runs of several processes only."""

import pytest
from spreading import goal_seekers
from simulating import COMMAND

from symaware_cli.network.transport.tcp import Tcp
from symaware_cli.scenario.build import build
