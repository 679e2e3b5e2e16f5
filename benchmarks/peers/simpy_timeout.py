"""A turn that does next to nothing, as SimPy's timeout event: ``python simpy_timeout.py PROCESSES TURNS``."""

import json
import random
import sys
import time
from collections.abc import Iterator

import simpy


def main() -> None:
    processes, turns = int(sys.argv[1]), int(sys.argv[2])
    environment = simpy.Environment()
    chance = random.Random(1)
    counts = [0] * processes

    def process(number: int, offset: float) -> Iterator[simpy.Event]:
        yield environment.timeout(offset)
        for _ in range(turns):
            counts[number] += 1
            yield environment.timeout(0.01)

    for number in range(processes):
        environment.process(process(number, chance.uniform(0.0, 0.01)))
    started = time.process_time()
    environment.run()
    cpu = time.process_time() - started
    print(json.dumps({"cpu": cpu, "turns": sum(counts)}))


if __name__ == "__main__":
    main()
