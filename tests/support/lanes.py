"""Steps that are shared among threads in any way that is allowed."""

import random

from emla_cosim.master.stepping.step_size_control import FixedSteps


def in_lanes(stepping: FixedSteps, seed: int = 1, count: int = 3) -> FixedSteps:
    """The same stepping, its tasks shared out at random, in any order that their dependencies leave."""
    algorithm, loop = stepping.algorithm, stepping.loop
    work, chance = algorithm.tasks(), random.Random(seed)
    lane_of = [chance.randrange(count) for _ in algorithm.network.instances]
    for task in work:
        for i in task.instances:
            lane_of[i] = lane_of[task.instances[0]]
    lanes, through = [list[int]() for _ in range(count)], set[int]()
    while len(through) < len(work):
        possible = [p for p, t in enumerate(work) if p not in through and through.issuperset(t.after)]
        position = chance.choice(possible)
        through.add(position)
        lanes[lane_of[work[position].instances[0]]].append(position)
    loop.share_out(lanes)
    assert loop.threads == count
    return stepping
