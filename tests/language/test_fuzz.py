"""No broken file may produce anything but a report: bytes of real documents, mutated.

SYMAWARE_FUZZ_CASES sets the number of cases for each format; the seed is fixed, so that a failure repeats.
"""

import json
import os
import random
import time
from pathlib import Path

import pytest

from symaware_cli.language.compose import compose
from symaware_cli.language.problem import Problem, ScenarioError, render, to_json

CASES = int(os.environ.get("SYMAWARE_FUZZ_CASES", "300"))

YAML = b"""\
# yaml-language-server: $schema=../schemas/scenario.schema.json
symaware: 1
name: crossing
extends: [base.yaml, base.toml]
parameters: {speed: 1.0, goals: [[8, 0], [0, 8]], who: "robot ${parameters.speed}"}
run: {mode: synchronous, duration: 30.0}
environment: {use: kinematic, with: {time_step: 0.05}}
agents:
  robot: &robot
    count: 4
    entity: {shape: {circle: {radius: 0.3}}, mass: 5.0}
    model: {use: unicycle, with: {max_speed: '${parameters.speed}'}}
    state: {uniform: [[-1, 0x1F], [.5, 1e3]]}
    knowledge:
      goal: ${parameters.goals}
      text: |
        several
        lines
    components:
      sense: {use: perception.range, with: {range: 6.0}}
      steer: {use: "control.go-to-goal\\t", on_failure: ~}
  other:
    <<: *robot
    count: !!int 2
    'quoted key': \xc3\xa9\xe4\xb8\x96
"""
TOML = b"""\
# a comment
symaware = 1
name = "crossing"
extends = ["base.yaml", "base.toml"]
parameters.speed = 1.0
parameters.goals = [[8, 0], [0, 8], # more
  [1, 2]]
run = {mode = "synchronous", duration = 30.0}
[environment]
use = 'kinematic'
with.time_step = 0.05
[agents.robot]
count = 0x4
state = {uniform = [[-1, 0], [1_000, 1e3]]}
"quoted key" = "\\u00e9\\t${parameters.speed}"
text = \"\"\"several
lines \\
  folded\"\"\"
literal = '''it's \xc3\xa9'''
[agents.robot.components.sense]
use = "perception.range"
with = {range = 6.0, on = true}
[[walls]]
x = 1
[[walls]]
x = '${parameters.goals}'
[walls.shape]
radius = 2.5
"""
_WORDS = rb"""
[ ] { } : , - ? # & * ! | > ' " % @ ` = . ~ << $ ${ } $${ \\ \x \u \U \ud800 ''' [[ ]] --- ... !! !foo *a *robot
../ / base.yaml null !!python/object/apply:os.system .nan nan -.inf inf 1e999 0x 0o9 1979-05-27 07:32:00 1:30 true
parameters ${parameters.speed} ${parameters.who} ${parameters.} ${parameters}
"""
# What cannot be written as words: blanks, control characters, broken UTF-8, and much of the same.
NASTY = [*_WORDS.split(), b"\t", b"\n", b"\r", b"\r\n", b" ", b"  ", b": ", b"- ", b"? ", b"\n\n", b"\n\t", b'"""']
NASTY += [
    b"\x00",
    b"\x1b[31m",
    b"\x7f",
    b"\xff",
    b"\xc3",
    b"\xed\xa0\x80",
    b"\xef\xbb\xbf",
    b"\xe2\x80\xa8",
    b"\xc2\xa0",
]
NASTY += [b"&a ", b"<<: *robot", b"!!binary ", b"!<tag:x> ", b"%YAML 1.1\n", b"[[a]]\n", b"\nname: 2", b"\nname = 2\n"]
NASTY += [
    word * 40 for word in (b"[", b"{", b"- ", b"a.", b"? ", b"{a: ", b"{a = ", b"9", b"\xf0\x9f\x98\x80", b"&a [*a, ")
]
NASTY += [b"9" * 5000, b"x" * 2000, b"extends: fuzz.yaml\n", b"extends = 'fuzz.toml'\n"]
OVERRIDES = [
    b"agents.robot.count=2",
    b"parameters.speed=[1, {a: 2}]",
    b"agents.robot.components.sense.with.range=",
    b"name=x",
]


def mutated(document: bytes, chance: random.Random) -> bytes:
    data = bytearray(document)
    for _ in range(chance.choice((1, 1, 1, 2, 3, 8))):
        at = chance.randrange(len(data) + 1)
        match chance.randrange(8):
            case 0 if data:
                data[at % len(data)] ^= 1 << chance.randrange(8)
            case 1 if data:
                data[at % len(data)] = chance.randrange(256)
            case 2:
                del data[at : at + chance.choice((1, 1, 2, 5, 30))]
            case 3:
                data[at:at] = chance.randbytes(chance.choice((1, 2, 5)))
            case 4:
                del data[at:]
            case 5:
                start = chance.randrange(len(data) + 1)
                data[at:at] = data[start : start + chance.randrange(80)]
            case _:
                data[at : at + chance.choice((0, 0, 1, 4))] = chance.choice(NASTY)
    return bytes(data)


@pytest.mark.parametrize(("suffix", "document"), [("yaml", YAML), ("toml", TOML)])
def test_every_mutation_produces_a_report(tmp_path: Path, suffix: str, document: bytes) -> None:
    (tmp_path / "base.yaml").write_text("name: base\nparameters: {speed: 2, other: 3}\nagents: {robot: {count: 1}}\n")
    (tmp_path / "base.toml").write_text("parameters.speed = 3\n[agents.robot]\nnote = 'n'\n")
    path = tmp_path / f"fuzz.{suffix}"
    path.write_bytes(document)
    compose(path)
    chance = random.Random(f"symaware {suffix}")
    slowest = 0.0
    whole = 0
    for case in range(CASES):
        data = mutated(document, chance)
        path.write_bytes(data)
        overrides = []
        if case % 4 == 0:
            overrides = [os.fsdecode(mutated(chance.choice(OVERRIDES), chance))]
        started = time.process_time()
        try:
            compose(path, overrides, f"fuzz.{suffix}")
            whole += 1
            problems: tuple[Problem, ...] = ()
        except ScenarioError as error:
            problems = error.problems
        except BaseException as error:
            error.add_note(f"case {case}: {overrides!r} {data!r}")
            raise
        shown = render(problems)
        took = time.process_time() - started
        slowest = max(slowest, took)
        assert took < 60, (overrides, data)
        assert all(character.isprintable() or character == "\n" for character in shown), (overrides, data)
        assert json.dumps(to_json(problems))
        for problem in problems:
            if problem.span and problem.source_line is not None:
                assert 1 <= problem.span.column <= len(problem.source_line) + 1, (overrides, data, problem)
                assert problem.span.end_column > problem.span.column
    print(f"{suffix}: {CASES} cases, {whole} accepted, slowest {slowest:.3f} s")
    assert 0 < whole < CASES
