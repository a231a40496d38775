"""Bodies and joints from files in URDF, which the package yourdfpy reads."""

import math
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from machine_fmu import GROUND, Body, Joint, Point
from machine_fmu.description import JointKind

from ...base.errors import CommandError
from ...base.extras import require_extra

_KINDS: dict[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "floating": "free",
    "fixed": "fixed",
}
"""Kinds of joints by their type in URDF; planar joints are not supported."""


class UrdfBodies(NamedTuple):
    """What a URDF file has of a machine: bodies by the names of its links, and points of the ground.

    Each parent is before its children. Each body, and the ground, has a point for each joint that it carries,
    with the joint's name.
    """

    bodies: dict[str, Body]
    ground: dict[str, Point]


def read_urdf(path: Path) -> UrdfBodies:
    """Return the bodies of a URDF file, whose root link is the ground.

    Raises:
        CommandError: The file cannot be read, or has a joint that is not supported.
    """
    label = f"the URDF file '{path}'"
    require_extra("urdf", label)
    reader = import_module("yourdfpy")  # slow
    if not path.is_file():
        raise CommandError(f"{label} does not exist.")
    try:
        ElementTree.parse(path)  # yourdfpy repairs wrong XML, and then misses what is lost
        robot: Any = reader.URDF.load(str(path), load_meshes=False, build_scene_graph=False).robot
    except Exception as error:  # of XML, and of many kinds for values
        raise CommandError(f"{label} cannot be read: {error}.") from error
    # the ground is what nothing carries
    roots = {link.name for link in robot.links} - {joint.child for joint in robot.joints}
    if len(roots) != 1:
        raise CommandError(f"{label} has {len(roots)} links without a parent; it must have one, the ground.")
    (root,) = roots
    links, bodies = {link.name: link for link in robot.links}, dict[str, Body]()
    for joint in _sort_parents_first(robot.joints, root):
        if joint.type not in _KINDS:
            raise CommandError(
                f"the joint '{joint.name}' of {label} is {joint.type}; it must be one of {', '.join(_KINDS)}."
            )
        axis = (1.0, 0.0, 0.0) if joint.axis is None else tuple(float(x) for x in joint.axis)
        parent = GROUND if joint.parent == root else joint.parent
        body_joint = Joint(_KINDS[joint.type], parent, joint.name, axis, _read_angles(joint.origin))
        bodies[joint.child] = _build_body(
            links[joint.child], body_joint, _list_points(robot.joints, joint.child)
        )
    return UrdfBodies(bodies, _list_points(robot.joints, root))


def _sort_parents_first(joints: Iterable[Any], root: str) -> list[Any]:
    """Return joints in an order in which each parent is before its children."""
    ordered, placed, waiting = list[Any](), {root}, list(joints)
    while ready := [joint for joint in waiting if joint.parent in placed]:
        ordered += ready
        waiting = [joint for joint in waiting if joint.parent not in placed]
        placed |= {joint.child for joint in ready}
    return ordered


def _list_points(joints: Iterable[Any], link: str) -> dict[str, Point]:
    """Return the points at which a link carries joints, by the names of these joints."""
    return {joint.name: Point(_read_position(joint.origin)) for joint in joints if joint.parent == link}


def _build_body(link: Any, joint: Joint, points: dict[str, Point]) -> Body:
    """Return a body with the inertia of a link about its centre, in the directions of the link's frame."""
    inertial = link.inertial
    if inertial is None:
        return Body(joint, points=points)
    R = np.eye(3) if inertial.origin is None else np.asarray(inertial.origin)[:3, :3]
    J = R @ np.asarray(inertial.inertia, dtype=float) @ R.T
    entries = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    m = 0.0 if inertial.mass is None else float(inertial.mass)
    return Body(joint, m, _read_position(inertial.origin), tuple(float(x) for x in entries), points)


def _read_position(origin: Any) -> tuple[float, ...]:
    return (0.0, 0.0, 0.0) if origin is None else tuple(float(x) for x in np.asarray(origin)[:3, 3])


def _read_angles(origin: Any) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of an origin."""
    if origin is None:
        return 0.0, 0.0, 0.0
    R = np.asarray(origin)[:3, :3]
    pitch = math.asin(min(max(-R[2, 0], -1.0), 1.0))
    if abs(R[2, 0]) > 1.0 - 1e-12:  # roll and yaw are about the same axis
        return math.atan2(-R[1, 2], R[1, 1]), pitch, 0.0
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])
