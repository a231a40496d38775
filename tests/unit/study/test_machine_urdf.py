"""Bodies of machines from URDF files, against Pinocchio's reader."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.study.machines.schema import parse_machine
from machine_fmu import Dynamics, assemble, find_closure

pin = pytest.importorskip("pinocchio", reason="Pinocchio has no package for Windows.")
pytest.importorskip("yourdfpy")

URDF = """
<robot name="crane">
  <link name="base"/>
  <link name="boom">
    <inertial>
      <origin xyz="1 0.1 0.2" rpy="0.3 -0.2 0.5"/>
      <mass value="100"/>
      <inertia ixx="3" iyy="30" izz="31" ixy="0.2" ixz="-0.3" iyz="0.4"/>
    </inertial>
  </link>
  <link name="jib">
    <inertial>
      <origin xyz="0.5 0 0"/><mass value="40"/>
      <inertia ixx="1" iyy="5" izz="5" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="elbow" type="revolute">
    <parent link="boom"/><child link="jib"/>
    <origin xyz="2 0 0.1" rpy="0.1 0.4 -0.2"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="foot" type="continuous">
    <parent link="base"/><child link="boom"/>
    <origin xyz="0 0 1" rpy="0 0 0.7"/><axis xyz="0 -1 0"/>
  </joint>
</robot>
"""
MACHINE = """
kind = "machine"
description = "A crane from a file of a CAD program"
dimensions = 3
urdf = "crane.urdf"
urdf_links.boom = { assembly = "40 deg", passive = true }
urdf_links.jib = { assembly = "-60 deg", passive = true }
"""


def test_urdf_has_the_masses_of_pinocchio(tmp_path: Path) -> None:
    file = tmp_path / "crane.urdf"
    file.write_text(URDF, encoding="utf-8")
    machine = parse_machine(tomllib.loads(MACHINE), "the machine", tmp_path)
    model = pin.buildModelFromUrdf(str(file))
    data, q, v, a = model.createData(), [0.7, -1.0], [0.4, -0.6], [1.0, 2.0]
    angles = np.concatenate([[np.cos(q[0]), np.sin(q[0])], q[1:]])  # a continuous joint has both
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    expected = pin.rnea(model, data, angles, np.array(v), np.array(a))
    actual = Dynamics(assemble(machine), find_closure(machine), [], q).inverse(v, a)
    assert actual == pytest.approx(expected.tolist(), rel=1e-12)


def test_unknown_link(tmp_path: Path) -> None:
    (tmp_path / "crane.urdf").write_text(URDF, encoding="utf-8")
    content = tomllib.loads(MACHINE.replace("links.jib", "links.jibb"))
    with pytest.raises(CommandError, match=r"unknown entry 'jibb'; did you mean 'jib'\?"):
        parse_machine(content, "the machine", tmp_path)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"the URDF file '.*crane\.urdf' does not exist\."):
        parse_machine(tomllib.loads(MACHINE), "the machine", tmp_path)
