"""The interval of a sweep ended by a rule has the nominal coverage."""

import json
from pathlib import Path

import pytest
from sweeping import rows, symaware

from symaware_cli.studies.statistics.confidence_sequence import BetaMixture

#: A stationary body, which is in the left eight tenths of an arena with a probability of 0.8.
COIN = """\
symaware: 1
name: coin
run: {duration: 0.1}
environment: {use: kinematic, with: {time_step: 0.1}}
specifications: {left: {each: body, formula: "always position[0] < 0.8"}}
agents:
  body:
    model: {use: single-integrator}
    state: {uniform: [[0, 0], [1, 1]]}
    components: {sense: {use: perception.self}}
"""


@pytest.mark.slow
def test_the_final_intervals_of_twenty_sweeps_cover_the_probability(tmp_path: Path) -> None:
    scenario = tmp_path / "coin.yaml"
    scenario.write_text(COIN)
    covered = 0
    for seed in range(20):
        options = ["--runs", 2000, "--seed", seed, "--with", "until=halfwidth(satisfied.left) < 0.1", "--jobs", 0]
        said = json.loads(symaware("sweep", scenario, "-o", tmp_path / f"{seed}", *options, "--json"))
        values = [float(row["verdict.left"] == "satisfied") for row in rows(tmp_path / f"{seed}")]
        assert 20 <= said["runs"] == len(values) < 2000
        sequence = BetaMixture()
        sequence.update(values)
        assert sequence.estimate().halfwidth < 0.1
        covered += sequence.estimate().covers(0.8)
    assert covered >= 19
