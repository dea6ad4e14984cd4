"""ROS 2 over DDS, without a ROS installation; needs the extra ``ros``."""

from tactophone.bridges.ros.bridge import RosBridge
from tactophone.bridges.ros.sinks import open_sinks
from tactophone.bridges.ros.source import RosSource

__all__ = ["RosBridge", "RosSource", "open_sinks"]
