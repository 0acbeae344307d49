"""The nodes of the chain, for everything that starts them; imports neither ROS nor the nodes."""

from importlib import import_module
from typing import Any, NamedTuple


class Entry(NamedTuple):
    """One node: its name, which is its executable's too, and where its class is."""

    name: str
    module: str
    class_name: str

    def load(self) -> Any:
        """The node's class."""
        return getattr(import_module(self.module), self.class_name)


# In the order of the data: nodes are started from the end, so that no first message is lost, and
# stopped from the beginning.
NODES = (
    Entry('lytro_driver', 'pmcl_ros.nodes.lytro_driver', 'LytroDriver'),
    Entry('subaperture_node', 'pmcl_ros.nodes.subaperture_node', 'SubapertureNode'),
    Entry('dlv_node', 'pmcl_ros.nodes.dlv_node', 'DlvNode'),
    Entry('pmcl_node', 'pmcl_ros.nodes.pmcl_node', 'PmclNode'),
)
# After the chain, where it is wanted: bring-up and launch start it when they get a grasp file.
GRASPS = Entry('grasp_node', 'pmcl_ros.nodes.grasp_node', 'GraspNode')
# In place of lytro_driver and subaperture_node, where a camera is moved instead: when bring-up and
# launch get a plan of its sweep.
SWEEP = Entry('sweep_driver', 'pmcl_ros.nodes.sweep_driver', 'SweepDriver')
SWEPT = ('lytro_driver', 'subaperture_node')  # what it takes the place of
ALL = (*NODES, GRASPS, SWEEP)
