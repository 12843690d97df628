"""rviz on a virtual display, for tests."""
import contextlib
import os
import re
import subprocess
import tempfile
import unittest

import numpy
import rospkg
import rospy
import yaml
from std_msgs.msg import Bool, String

import support
from support import NODE

PACKAGE = rospkg.RosPack().get_path("constraint_sim")
WIDTH, HEIGHT = 1280, 800
START = 180.0  # time for rviz to start; it draws without a graphics card, beside other programs [s]


class SendFilePath:
    """The service rviz/SendFilePath, whose Python type is in a package that is not needed otherwise."""
    _type, _md5sum, _request_class, _response_class = "rviz/SendFilePath", "*", String, Bool


def shipped_configuration():
    """Returns the shipped configuration without the panel, so that the view fills the window."""
    with open(os.path.join(PACKAGE, "config/constraint_sim.rviz")) as file:
        text = file.read()
    text, count = re.subn(r"  - Class: constraint_sim/Simulator\n(?:    .*\n)+", "", text)
    assert count == 1
    return text


def fitted_configuration(scene):
    """Returns that configuration with the view that the launch file sets for this scene."""
    text = subprocess.check_output(["rosrun", "constraint_sim", "rviz_config", scene],
                                   universal_newlines=True)
    config = yaml.safe_load(text)
    config["Panels"] = [p for p in config["Panels"] if p["Class"] != "constraint_sim/Simulator"]
    return yaml.safe_dump(config)


def read_view(path):
    """Returns the 3-D view of a screenshot as an array of rows, columns, rgb."""
    raw = subprocess.check_output(["convert", path, "-depth", "8", "rgb:-"])
    picture = numpy.frombuffer(raw, numpy.uint8).reshape(HEIGHT, WIDTH, 3)
    return picture[70:760, 24:1256].astype(float)


def with_few_pictures(configuration):
    """Returns the configuration with five pictures a second. Drawn without a graphics card, thirty take a whole core;
    between two pictures rviz answers one question after the widgets of its panel."""
    configuration, count = re.subn("Frame Rate: [0-9]+", "Frame Rate: 5", configuration)
    assert count == 1
    return configuration


def environment_on(display, folder):
    """Returns the environment of rviz on a display. Its home is an own folder, since rviz keeps settings there, which
    other tests must neither see nor write; caches of fonts and shaders may be shared."""
    caches = os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~/.cache"))
    return dict(os.environ, DISPLAY=display, LIBGL_ALWAYS_SOFTWARE="1", HOME=folder, XDG_CACHE_HOME=caches,
                XDG_RUNTIME_DIR=folder)


@contextlib.contextmanager
def virtual_display():
    reading, writing = os.pipe()
    with support.running(["Xvfb", "-displayfd", str(writing), "-screen", "0",
                          "%dx%dx24" % (WIDTH, HEIGHT), "-nolisten", "tcp", "-noreset"],
                         pass_fds=[writing], stderr=subprocess.DEVNULL):
        os.close(writing)
        with os.fdopen(reading) as number:
            yield ":" + number.readline().strip()


class InRviz(unittest.TestCase):
    """Runs rviz with a configuration, on an own display."""
    configuration = None  # or each test shows one
    most_restarts, restarts = 3, 0  # restarts of rviz, where it ends by itself

    @classmethod
    def setUpClass(cls):
        cls.stack = contextlib.ExitStack()
        display = cls.stack.enter_context(virtual_display())
        cls.folder = cls.stack.enter_context(tempfile.TemporaryDirectory())
        cls.environment = environment_on(display, cls.folder)
        cls.prepare()
        cls.rviz = None
        if cls.configuration:
            cls.show_configuration(cls.configuration())

    @classmethod
    def show_configuration(cls, configuration):
        """Starts rviz with this configuration, or loads it in the running rviz, which is faster."""
        configuration = with_few_pictures(configuration)
        with open(os.path.join(cls.folder, "view.rviz"), "w") as file:
            file.write(configuration)
        if cls.rviz is None:
            cls.start_rviz()
        elif not cls.has_restarted():
            service = "/rviz/load_config_discarding_changes"
            rospy.wait_for_service(service, timeout=START)
            assert rospy.ServiceProxy(service, SendFilePath)(String(file.name)).data, configuration
            cls.wait_for_displays()

    @classmethod
    def start_rviz(cls):
        with open(os.path.join(cls.folder, "rviz.log"), "w") as log:
            cls.rviz = cls.stack.enter_context(support.running(
                ["rviz", "-d", os.path.join(cls.folder, "view.rviz"), "__name:=rviz"], env=cls.environment,
                stdout=log, stderr=subprocess.STDOUT))
        cls.wait_for_displays()

    @classmethod
    def wait_for_displays(cls):
        support.wait_until(
            lambda: NODE + "/hands/update" in support.topics_between(NODE, "/rviz") or cls.has_restarted(),
            "rviz", START)

    @classmethod
    def has_restarted(cls):
        """Starts rviz again if it has ended by itself, says so, and returns whether it did. More than
        most_restarts ends in one test program fail."""
        if cls.rviz.poll() is None:
            return False
        with open(os.path.join(cls.folder, "rviz.log")) as log:
            end = "rviz ended with code %d:\n%s" % (cls.rviz.returncode, log.read()[-2000:])
        cls.restarts += 1
        if cls.restarts > cls.most_restarts:
            raise AssertionError(end)
        rospy.logerr(end)
        cls.start_rviz()
        return True

    @classmethod
    def tearDownClass(cls):
        cls.stack.close()

    @classmethod
    def prepare(cls):
        """Prepares further needs of rviz beside the display."""

    def screenshot(self, name):
        """Takes a screenshot; returns its path, in the folder of CONSTRAINT_SIM_SCREENSHOTS if that is
        set."""
        path = os.path.join(os.environ.get("CONSTRAINT_SIM_SCREENSHOTS", self.folder), name)
        subprocess.check_call(["import", "-window", "root", path], env=self.environment, timeout=START)
        return path

    def shrink(self, name, width, zoom=1):
        """Saves the view of that screenshot, or its middle, as WebP, small enough for a page."""
        path = os.path.join(os.environ.get("CONSTRAINT_SIM_SCREENSHOTS", self.folder), name)
        middle = "%dx%d+0+0" % (1232 / zoom, 690 / zoom)
        subprocess.check_call(["convert", path, "-crop", "1232x690+24+70", "+repage",
                               "-gravity", "center", "-crop", middle, "+repage",
                               "-resize", "%dx" % width, "-quality", "75", "-define", "webp:method=6",
                               os.path.splitext(path)[0] + ".webp"])
