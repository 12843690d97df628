"""Imports control_msgs, or builds its Python module FollowJointTrajectory from cmake/control_msgs where that package
is missing, as on Debian. Without it no action client runs."""
import glob
import os
import subprocess
import sys
import tempfile

import roslib.packages
import rospkg

SOURCES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "cmake", "control_msgs")


def build(folder):
    """Builds a package control_msgs in this folder, as catkin does: an action's messages, then their modules."""
    messages = os.path.join(folder, "msg")
    os.makedirs(messages)
    program = roslib.packages.find_node("actionlib_msgs", "genaction.py")
    generator = roslib.packages.find_node("genpy", "genmsg_py.py")
    with open(os.path.join(SOURCES, "JointTolerance.msg")) as source:
        with open(os.path.join(messages, "JointTolerance.msg"), "w") as copy:
            copy.write(source.read())
    python = "/usr/bin/python3"
    subprocess.check_call([python, program[0], os.path.join(SOURCES, "FollowJointTrajectory.action"), "-o", messages],
                          stdout=subprocess.DEVNULL)
    paths = ["-Icontrol_msgs:" + messages]
    for package in ("actionlib_msgs", "geometry_msgs", "std_msgs", "trajectory_msgs"):
        paths.append("-I%s:%s/msg" % (package, rospkg.RosPack().get_path(package)))
    module = os.path.join(folder, "control_msgs", "msg")
    os.makedirs(module)
    open(os.path.join(folder, "control_msgs", "__init__.py"), "w").close()
    for message in glob.glob(messages + "/*.msg"):
        subprocess.check_call([python, generator[0], message, "-p", "control_msgs", "-o", module] + paths)
    subprocess.check_call([python, generator[0], "--initpy", "-p", "control_msgs", "-o", module])


try:
    import control_msgs.msg  # noqa: F401
    IS_COPY = False
except ImportError:
    FOLDER = tempfile.TemporaryDirectory()
    build(FOLDER.name)
    sys.path.insert(0, FOLDER.name)
    IS_COPY = True
