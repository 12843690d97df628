"""The Python side of constraint_sim: `engine`, `sweep`, and with ROS the messages `msg` and `srv`."""
import pkgutil

# the engine's module lies apart from these files until it is installed
__path__ = pkgutil.extend_path(__path__, __name__)
