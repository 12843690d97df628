"""rviz with the panel, with a real mouse and keys, for tests."""
import contextlib
import subprocess

import accessible
import support
from in_rviz import START, InRviz
from support import NODE, Listener, node_command, properties, wait_until

PANEL_TOPICS = {NODE + "/" + name for name in ("statistics", "scene", "body_states", "constraint_states")}
PANEL = 800  # columns of the view beside the panel


def topics_of_panel():
    return support.topics_between(NODE, "/rviz") & PANEL_TOPICS


def changed(before, after):
    """Returns the share of pixels that have changed."""
    return (abs(after - before).max(axis=-1) > 20.0).mean()


class WithPanel(InRviz):
    """Runs a node, and rviz with the shipped configuration."""
    most_restarts = 0  # an end of rviz may be the panel's fault

    @classmethod
    def setUpClass(cls):
        cls.outer = contextlib.ExitStack()
        cls.node = cls.outer.enter_context(support.running(node_command(scene="winch", paused=True)))
        properties()  # the node is up
        super().setUpClass()
        cls.desktop = accessible.Desktop(cls.bus)
        # other panels have buttons of equal names
        cls.panel = wait_until(lambda: cls.desktop.root.find("Simulator"), "the panel", START)
        window = subprocess.check_output(
            ["xdotool", "search", "--onlyvisible", "--name", "RViz"], env=cls.environment,
            universal_newlines=True, timeout=START).split()[0]
        subprocess.check_call(["xdotool", "windowfocus", window], env=cls.environment, timeout=START)
        cls.widgets = {}

    @classmethod
    def tearDownClass(cls):
        super().tearDownClass()
        cls.outer.close()

    @classmethod
    def prepare(cls):
        cls.bus = cls.stack.enter_context(accessible.session(cls.environment))

    @staticmethod
    def configuration():
        """Returns the configuration with the view that the launch file sets for the bridge."""
        return subprocess.check_output(["rosrun", "constraint_sim", "rviz_config", "bridge"],
                                       universal_newlines=True)

    def tearDown(self):
        Listener.stop_all()

    def widget(self, name):
        if name not in self.widgets:
            self.widgets[name] = wait_until(lambda: self.panel.find(name), name, START)
        return self.widgets[name]

    def xdotool(self, *arguments):
        subprocess.check_call(["xdotool", *map(str, arguments)], env=self.environment, timeout=START)

    def click(self, name):
        self.xdotool("mousemove", *self.widget(name).centre())
        self.xdotool("click", 1)

    def keys(self, *keys):
        self.xdotool("key", *keys)

    def enter(self, name, text):
        """Replaces the text of a field."""
        self.click(name)
        self.keys("ctrl+a")
        self.xdotool("type", text)
        self.keys("Return")

    def messages(self):
        return self.widget("Messages").text()

    def wait_for_message(self, text):
        wait_until(lambda: text in self.messages(), "the message '%s'" % text, START)

    def wait_for_hash(self, expected, what):
        try:
            wait_until(lambda: properties().state_hash == expected, what, START)
        except AssertionError:  # shows the view
            self.screenshot("panel_in_vain.png")
            print("the panel says:\n" + self.messages())
            raise
