"""The arm of a Fetch with its gripper, as a specification for MuJoCo."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.simulation.manipulation.physics import mujoco

Vector = tuple[float, float, float]

TOOL = 'gripper_link'
FINGERS = 'left_finger', 'right_finger'
GRIPPER = 'gripper'  # the actuator
# Bits of contacts: robot with fixed things and the object, these two with each other, and of the
# robot the hand with the upper arm.
ROBOT, FIXED, OBJECT, HAND = 1, 2, 4, 8
STEP = 0.002  # s
LIFT = 0.30  # m: of the torso
_SHOULDER = -0.0869 + 0.1195, 0.0, 0.3774 + LIFT + 0.3486  # of the pan joint, in base_link
_STIFF, _LAG = 2500.0, 0.04  # 1/s^2, s: of the joints' controllers; one lag keeps the path
_FORCE = 40.0  # N: of each finger
_PAD = 0.7, 0.01, 0.001  # friction of a rubber pad on wet glass: sliding, of turns [m], rolling


@dataclass(frozen=True)
class Joint:
    """A joint and the link behind it, as in the URDF of fetch_description.

    offset: of the joint in the link before it [m]. axis: x, y or z. limits [rad], None: it turns
    freely. effort [Nm], velocity [rad/s]: largest. mass [kg], length, radius [m]: of the link,
    along its x. inertia: about the axis, of all that the joint moves, outstretched [kg m^2].
    """

    name: str
    offset: Vector
    axis: Vector
    limits: tuple[float, float] | None
    effort: float
    velocity: float
    mass: float
    length: float
    radius: float
    inertia: float


_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ARM = (
    Joint('shoulder_pan', _SHOULDER, _Z, (-1.6056, 1.6056), 33.82, 1.256, 2.56, 0.117, 0.06, 3.0),
    Joint('shoulder_lift', (0.117, 0, 0.06), _Y, (-1.221, 1.518), 131.76, 1.454, 2.66, 0.219,
          0.065, 3.0),
    Joint('upperarm_roll', (0.219, 0, 0), _X, None, 76.94, 1.571, 2.33, 0.133, 0.06, 1.0),
    Joint('elbow_flex', (0.133, 0, 0), _Y, (-2.251, 2.251), 66.18, 1.521, 2.13, 0.197, 0.06, 1.0),
    Joint('forearm_roll', (0.197, 0, 0), _X, None, 29.35, 1.571, 1.66, 0.1245, 0.055, 0.5),
    Joint('wrist_flex', (0.1245, 0, 0), _Y, (-2.16, 2.16), 25.7, 2.268, 1.73, 0.1385, 0.055, 0.3),
    Joint('wrist_roll', (0.1385, 0, 0), _X, None, 7.36, 2.268, 0.14, 0.0, 0.0, 0.1))
HOME = np.array([0.0, -1.1, 0.0, 2.0, 0.0, -0.9, 0.0])  # above what is before the robot
VELOCITIES = np.array([each.velocity for each in ARM])
_BODY = {  # what the arm must not strike of the robot itself: lower and upper corners
    'base': ((-0.28, -0.28, 0.0), (0.28, 0.28, 0.36)),
    'torso': ((-0.26, -0.17, 0.36), (-0.02, 0.17, 1.1)),
    'head': ((-0.08, -0.13, 1.29), (0.17, 0.13, 1.45))}


def fetch_arm(gripper: GripperSettings, fingers: bool = True) -> Any:
    """The arm's `mujoco.MjSpec`, in base_link; its joints are those of `ARM`, in this order.

    fingers: those of the gripper move, by the actuator `GRIPPER`, whose command is the gap between
    them [m]. Without them it is a chain, for inverse kinematics. Raises SimulationError where
    MuJoCo is not installed.
    """
    mj = mujoco()
    spec = mj.MjSpec()
    spec.compiler.degree = False
    _set_options(mj, spec)
    for name, (low, high) in _BODY.items():
        add_box(spec.worldbody, name, np.array(low), np.array(high), FIXED, ROBOT)
    body = spec.worldbody
    for link in ARM:
        body = _add_link(mj, spec, body, link)
    tool = body.add_body(name=TOOL, pos=gripper.parent_to_grasp, gravcomp=1)
    boxes = gripper.boxes(0.0)
    low, high = boxes[2]
    add_box(tool, 'palm', low, high, ROBOT | HAND, FIXED | OBJECT).mass = 1.5
    if fingers:
        _add_fingers(mj, spec, tool, boxes, gripper.opening)
    return spec


def add_box(body: Any, name: str, low: NDArray[np.float64], high: NDArray[np.float64],
            kind: int, touches: int) -> Any:
    """A box between two corners, of a body; returns its geom. kind, touches: bits of contacts."""
    return body.add_geom(name=name, type=mujoco().mjtGeom.mjGEOM_BOX, pos=(low + high) / 2,
                         size=(high - low) / 2, contype=kind, conaffinity=touches,
                         rgba=(0.6, 0.6, 0.62, 1))


def _set_options(mj: Any, spec: Any) -> None:
    """What holds without creeping: elliptic cones, and steps against slip."""
    option = spec.option
    option.timestep, option.integrator = STEP, mj.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone, option.impratio = mj.mjtCone.mjCONE_ELLIPTIC, 10
    option.noslip_iterations = 4


def _add_link(mj: Any, spec: Any, parent: Any, link: Joint) -> Any:
    """A link with its joint and its actuator; returns its body."""
    body = parent.add_body(name=f'{link.name}_link', pos=link.offset, gravcomp=1)
    joint = body.add_joint(name=link.name, type=mj.mjtJoint.mjJNT_HINGE, axis=link.axis,
                           armature=0.1, damping=0.5)
    if link.limits is not None:
        joint.limited, joint.range = mj.mjtLimited.mjLIMITED_TRUE, link.limits
    if link.length:
        geom = body.add_geom(name=f'{link.name}_link', type=mj.mjtGeom.mjGEOM_CAPSULE,
                             size=(link.radius, 0, 0), fromto=(0, 0, 0, link.length, 0, 0),
                             contype=ROBOT, conaffinity=FIXED | OBJECT, mass=link.mass,
                             rgba=(0.3, 0.45, 0.7, 1))
        if link.name == 'shoulder_pan':  # within the torso
            geom.contype = geom.conaffinity = 0
        if link.name in ('shoulder_lift', 'upperarm_roll'):
            geom.conaffinity |= HAND
        if link.name == 'wrist_flex':
            geom.contype |= HAND
    else:
        body.mass, body.inertia, body.explicitinertial = link.mass, (1e-4, 1e-4, 1e-4), True
    actuator = spec.add_actuator(name=link.name, target=link.name,
                                 trntype=mj.mjtTrn.mjTRN_JOINT)
    stiffness = _STIFF * link.inertia
    actuator.set_to_position(kp=stiffness, kv=stiffness * _LAG)
    actuator.forcelimited, actuator.forcerange = True, (-link.effort, link.effort)
    return body


def _add_fingers(mj: Any, spec: Any, tool: Any, boxes: NDArray[np.float64], opening: float
                 ) -> None:
    """Two fingers that close by the same way, driven by one motor."""
    tendon = spec.add_tendon(name=GRIPPER)
    for name, side, (low, high) in zip(FINGERS, (1, -1), boxes[:2], strict=True):
        body = tool.add_body(name=name, gravcomp=1)
        body.add_joint(name=name, type=mj.mjtJoint.mjJNT_SLIDE, axis=(0, side, 0),
                       limited=mj.mjtLimited.mjLIMITED_TRUE, range=(0, opening / 2),
                       armature=0.5, damping=20)
        geom = add_box(body, name, low, high, ROBOT, FIXED | OBJECT)
        geom.mass, geom.friction, geom.condim, geom.priority = 0.1, _PAD, 4, 1
        # Else the pads would sink into a light object by millimetres.
        geom.solref[:2], geom.solimp[:2] = (2 * STEP, 1), (0.95, 0.99)
        geom.rgba = (0.15, 0.15, 0.15, 1)
        tendon.wrap_joint(name, 1.0)
    spec.add_equality(type=mj.mjtEq.mjEQ_JOINT, name1=FINGERS[0], name2=FINGERS[1],
                      objtype=mj.mjtObj.mjOBJ_JOINT, data=[0, 1] + [0] * 10,
                      solref=(2 * STEP, 1))
    actuator = spec.add_actuator(name=GRIPPER, target=GRIPPER, trntype=mj.mjtTrn.mjTRN_TENDON)
    actuator.set_to_position(kp=4000, kv=100)
    actuator.forcelimited, actuator.forcerange = True, (-_FORCE, _FORCE)
