"""Plans, and what is given beside them."""

from emla_cosim.sweep.plan import Plan


def test_what_is_given_beside_a_plan_adds_to_its_tables() -> None:
    plan = Plan("p", "lift", {"a.x": [1]}, options={"stop_time": 1.0, "set": {"a.y": 1.0, "a.z": 2.0}})
    changed = plan.updated({"vary": {"a.w": [2]}, "options": {"stop_time": 2.0, "set": {"a.z": 3.0}}})
    assert changed.vary == {"a.x": [1], "a.w": [2]}
    assert changed.options == {"stop_time": 2.0, "set": {"a.y": 1.0, "a.z": 3.0}}
    assert plan.options == {"stop_time": 1.0, "set": {"a.y": 1.0, "a.z": 2.0}}
