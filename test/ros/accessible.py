"""Widgets of a program by their names, as a screen reader finds them (AT-SPI over D-Bus)."""
import contextlib
import os
import subprocess

import gi
gi.require_version("Gio", "2.0")
from gi.repository import Gio, GLib  # noqa: E402  (as gi wants it)

import support  # noqa: E402

ACCESSIBLE, COMPONENT, TEXT = ("org.a11y.atspi." + name
                               for name in ("Accessible", "Component", "Text"))
ON_SCREEN = 0
TAB_BAR = 38  # role of the element with the name of its front tab
CELLS = 56  # role of a table cell: a tree has thousands


@contextlib.contextmanager
def session(environment):
    """Starts an own session bus; puts its address into the environment and yields it."""
    with support.running(["dbus-daemon", "--session", "--nofork", "--nopidfile", "--print-address"],
                         stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment,
                         universal_newlines=True) as daemon:
        environment["DBUS_SESSION_BUS_ADDRESS"] = address = daemon.stdout.readline().strip()
        environment["QT_LINUX_ACCESSIBILITY_ALWAYS_ON"] = environment["QT_ACCESSIBILITY"] = "1"
        yield address


def connect(address):
    flags = (Gio.DBusConnectionFlags.AUTHENTICATION_CLIENT |
             Gio.DBusConnectionFlags.MESSAGE_BUS_CONNECTION)
    return Gio.DBusConnection.new_for_address_sync(address, flags, None, None)


class Desktop:
    """Programs on a bus. The first one starts the registry, with which only Qt programs register that run already:
    rviz started after the registry was not found in eight of eight tries."""
    def __init__(self, session_address):
        answer = connect(session_address).call_sync(
            "org.a11y.Bus", "/org/a11y/bus", "org.a11y.Bus", "GetAddress", None, None, 0, -1, None)
        self.bus = connect(answer.unpack()[0])
        self.root = Widget(self, "org.a11y.atspi.Registry", "/org/a11y/atspi/accessible/root")


class Widget:
    def __init__(self, desktop, owner, path):
        self.desktop, self.owner, self.path = desktop, owner, path

    def call(self, interface, method, signature=None, *arguments):
        parameters = GLib.Variant(signature, arguments) if signature else None
        answer = self.desktop.bus.call_sync(self.owner, self.path, interface, method, parameters,
                                            None, 0, -1, None)
        return answer.unpack()

    def get(self, interface, key):
        return self.call("org.freedesktop.DBus.Properties", "Get", "(ss)", interface, key)[0]

    def name(self):
        return self.get(ACCESSIBLE, "Name")

    def role(self):
        return self.call(ACCESSIBLE, "GetRole")[0]

    def children(self):
        return [Widget(self.desktop, owner, path)
                for owner, path in self.call(ACCESSIBLE, "GetChildren")[0]]

    def below(self):
        """Yields all widgets in this one, nearest first, except those in cells."""
        level = [self]
        while level:
            yield from level
            level = [child for widget in level for child in self.children_of(widget)]

    @staticmethod
    def children_of(widget):
        try:
            return [] if widget.role() == CELLS else widget.children()
        except GLib.Error:
            return []  # the widget is gone

    def find(self, name):
        """Returns the nearest widget of this name, or None."""
        return self.find_where(lambda found: found == name)

    def find_containing(self, text):
        return self.find_where(lambda found: text in found)

    def find_where(self, fits):
        for widget in self.below():
            with contextlib.suppress(GLib.Error):  # gone meanwhile
                if fits(widget.name()) and widget.role() != TAB_BAR:
                    return widget
        return None

    def centre(self):
        x, y, width, height = self.call(COMPONENT, "GetExtents", "(u)", ON_SCREEN)[0]
        return x + width // 2, y + height // 2

    def text(self):
        return self.call(TEXT, "GetText", "(ii)", 0, -1)[0]
