#!/usr/bin/env python3
"""Runs ten clients that edit, query and reload at the same time, and checks the node and all calls.

Starts a master and a node of its own on a running scene. Each client is a process with a body of its
own: it adds the body, sets its state, reads it back, applies a force, changes its friction, removes it,
and queries the world and the scene; the first client loads another scene every two seconds. A call
is lost without a response, or where the response contradicts the call: the value of an accepted edit is
missing although no scene was loaded in between. Topics are subscribed meanwhile.

Prints the calls, lost calls, response times, the node's memory and the ticks that it
dropped. Exits with 1 where a call was lost, the node ended, or one of 1000 responses took 0.5 s or more.

    bench/ros/ten_clients.py --minutes 10
    bench/ros/ten_clients.py --minutes 60      a soak: memory over an hour
    bench/ros/ten_clients.py --persistent      one connection for all calls of a service
"""
import argparse
import contextlib
import multiprocessing
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import time
import xmlrpc.client

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from node_throughput import free_port, running, wait_until  # noqa: E402

NODE = "/constraint_sim"
SCENES = ("bridge", "pendulum", "winch", "newtons_cradle")
RELOAD = 2.0       # between scenes [s]
CALL_LIMIT = 60.0  # after which a call counts as lost [s]
BOUND = 0.5        # bound for 999 of 1000 response times [s]
SAMPLES = 10       # printed samples of memory


def client(index, rate, end, is_persistent, loads, results):
    """Calls at a steady rate until `end` [s of the steady clock]; puts its observations into results."""
    import rospy
    import rosservice
    from constraint_sim.msg import Body, BodyState

    rospy.init_node("client_%d" % index, disable_signals=True)
    draw = random.Random(index)
    proxies = {}
    name = "body_%d" % index
    seconds, refused, lost = [], 0, []

    def call(service, **fields):
        """Returns the response; None without one."""
        nonlocal refused
        if service not in proxies:
            proxies[service] = rospy.ServiceProxy(
                NODE + "/" + service, rosservice.get_service_class_by_name(NODE + "/" + service),
                persistent=is_persistent)
        start = time.monotonic()
        try:
            answer = proxies[service](**fields)
        except Exception as error:  # any failure means no response
            lost.append("%s: %s" % (service, error))
            del proxies[service]  # its connection, where it is persistent, is broken
            return None
        seconds.append(time.monotonic() - start)
        refused += not answer.success
        return answer

    def round_of_edits():
        state = BodyState(name=name)
        state.pose.position.x, state.pose.position.y = 100.0 * (index + 1), draw.uniform(-9.0, 9.0)
        state.pose.orientation.w = 1.0
        before = loads.value
        added = call("add_body", body=Body(name=name, type=Body.KINEMATIC, pose=state.pose))
        yield
        is_set = call("set_body_state", state=state)
        yield
        found = call("get_body_state", name=name)
        yield
        if (before == loads.value and before % 2 == 0 and None not in (added, is_set, found) and
                not (added.success and is_set.success and found.success and
                     found.state.pose.position == state.pose.position)):
            lost.append("an accepted edit of %s is not there: %s %s %s" %
                        (name, added.status_message, is_set.status_message, found.status_message))
        call("set_body_properties", name=name, keys=["friction"], values=[draw.random()])
        yield
        call("get_world_properties")
        yield
        call("save_scene")
        yield
        call("set_body_state", state=BodyState(name="nobody"))
        yield
        call("remove_body", name=name)
        yield

    rospy.wait_for_service(NODE + "/add_body", CALL_LIMIT)
    due, reload_due = time.monotonic(), time.monotonic() + RELOAD
    todo = iter(())
    while time.monotonic() < end:
        if index == 0 and time.monotonic() > reload_due:
            reload_due += RELOAD
            loads.value += 1  # odd: a scene is being loaded
            call("load_scene", path=draw.choice(SCENES))
            loads.value += 1
        if next(todo, todo) is todo:
            todo = round_of_edits()
        due = max(due + 1.0 / rate, time.monotonic() - 1.0)
        time.sleep(max(0.0, due - time.monotonic()))
    results.put((seconds, refused, lost))


def listen(results, done):
    """Subscribes to topics as rviz does; puts the numbers of messages, and ticks by the statistics, into
    results."""
    import rospy
    from constraint_sim.msg import Statistics

    rospy.init_node("listener", disable_signals=True)
    received, last = [0], [None]

    def count(_):
        received[0] += 1

    def keep(message):
        last[0] = message
    rospy.Subscriber(NODE + "/statistics", Statistics, keep)
    for topic in ("/tf", NODE + "/markers", NODE + "/body_states", NODE + "/events"):
        rospy.Subscriber(topic, rospy.AnyMsg, count)
    done.wait()
    results.put((received[0], last[0].step if last[0] else 0, last[0].dropped_ticks if last[0] else 0))


def memory_of(pid):
    """Returns the resident memory [MiB]."""
    with open("/proc/%d/status" % pid) as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS:")) / 1024


def at_share(ordered, share):
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def run(clients, minutes, rate, is_persistent):
    end = time.monotonic() + 60.0 * minutes
    results, heard, done = multiprocessing.Queue(), multiprocessing.Queue(), multiprocessing.Event()
    loads = multiprocessing.Value("i", 0)
    address = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"]).lookupNode("/ten", NODE)[2]
    pid = xmlrpc.client.ServerProxy(address).getPid("/ten")[2]
    workers = [multiprocessing.Process(target=client, args=(i, rate, end, is_persistent, loads, results))
               for i in range(clients)]
    listener = multiprocessing.Process(target=listen, args=(heard, done))
    for process in (*workers, listener):
        process.start()
    memory = []
    for sample in range(1, SAMPLES + 1):
        time.sleep(max(0.0, end - time.monotonic() - 60.0 * minutes * (1.0 - sample / SAMPLES)))
        memory.append(memory_of(pid))
    seconds, refused, lost = [], 0, []
    for _ in workers:
        more, refused_of, lost_of = results.get(timeout=2 * CALL_LIMIT)
        seconds += more
        refused += refused_of
        lost += lost_of
    done.set()
    messages, steps, dropped = heard.get(timeout=CALL_LIMIT)
    for process in (*workers, listener):
        process.join(CALL_LIMIT)
    seconds.sort()
    print("%d clients, %g minutes, %d scenes loaded, %d processors, load %.1f" %
          (clients, minutes, loads.value // 2, os.cpu_count(), os.getloadavg()[0]))
    print("%d calls answered, %d of them refused with a reason, %d lost" %
          (len(seconds), refused, len(lost)))
    print("answers took [ms]: median %.1f, 99 %% below %.1f, 99.9 %% below %.1f, longest %.1f" %
          tuple(1e3 * at_share(seconds, share) for share in (0.5, 0.99, 0.999, 1.0)))
    print("resident memory [MiB] at each tenth of the time: %s" %
          " ".join("%.1f" % each for each in memory))
    print("%d ticks done, %d left out; %d messages of topics heard" % (steps, dropped, messages))
    for each in lost[:10]:
        print("lost: " + each)
    return not lost and at_share(seconds, 0.999) < BOUND


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="how long; default: 10")
    parser.add_argument("--clients", type=int, default=10, help="default: 10")
    parser.add_argument("--rate", type=float, default=15.0, metavar="HZ",
                        help="calls per second of each client; default: 15")
    parser.add_argument("--persistent", action="store_true",
                        help="one connection for all calls of a service, instead of one a call")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        port = free_port()
        os.environ.update(ROS_MASTER_URI="http://localhost:%d" % port, ROS_HOME=folder,
                          ROS_HOSTNAME="localhost")
        master = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
        program = subprocess.check_output(["catkin_find", "--first-only", "--libexec", "constraint_sim",
                                           "constraint_sim_node"], universal_newlines=True).strip()
        with running(["roscore", "-p", str(port)]), contextlib.ExitStack() as stack:
            wait_until(lambda: master.getPid("/ten"), "the master")
            stack.enter_context(running([program, "__name:=constraint_sim", "_scene:=bridge"]))
            wait_until(lambda: master.lookupNode("/ten", NODE)[0] == 1, "the node")
            if not run(options.clients, options.minutes, options.rate, options.persistent):
                sys.exit(1)


if __name__ == "__main__":
    main()
