"""Parameter sets and gains of the joints that come with the study, by joint, as their files have them."""

from typing import Any

from emla_cosim.study.joints.schema import load_joint
from emla_fmu.drive import drive
from emla_fmu.observer_gains import ObserverGains
from rsba_fmu.gains import RsbaGains

JOINTS = {name: load_joint(name) for name in ("lift", "tilt", "telescope", "prototype")}

EMLAS = {name: joint.emla for name, joint in JOINTS.items()}
LIFT, TILT, TELESCOPE, PROTOTYPE = EMLAS.values()
DRIVES = {name: drive(joint.emla, joint.actuator.i_N) for name, joint in JOINTS.items()}


def gains_of(controller: str, name: str) -> dict[str, Any]:
    """Return a set of gains of a controller by joint."""
    return {
        name_of_joint: data.gain_set(controller, name).controller for name_of_joint, data in JOINTS.items()
    }


def observers(name: str) -> dict[str, ObserverGains]:
    """Return a set of gains of the observer by joint."""
    return {joint: data.observers[name].gains for joint, data in JOINTS.items()}


PUBLISHED: dict[str, RsbaGains] = gains_of("rsba", "published")
ROBUST: dict[str, RsbaGains] = gains_of("rsba", "robust")
COMPENSATED: dict[str, RsbaGains] = gains_of("rsba", "compensated")
DAMPED: dict[str, RsbaGains] = gains_of("rsba", "damped")
