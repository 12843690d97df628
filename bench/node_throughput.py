#!/usr/bin/env python3
"""Measures the number of bodies that the node simulates at a tick of 1 ms with 50 rounds of messages per second.

For each number of bodies it starts a master and a node of its own on a scene of chains, ten balls on
ten rods each, released from the horizontal. It listens to all topics that rviz and a recorder would,
and prints the node's own statistics over some seconds of wall time.

With --overhead instead: the cost of the node beyond the engine. Processor time per tick without
subscribers, less the node's own time for steps, and beside it these steps in the
runner, without anything in between; the share of a core with all topics subscribed; the latency
of a service call meanwhile, and the cost of a paused node.

With --count: checks that no message is built without subscribers. The node runs under callgrind, without and
with a subscriber; instructions of functions that build messages are printed, and must be 0 without one.
"""
import argparse
import contextlib
import json
import multiprocessing
import os
import re
import signal
import socket
import subprocess
import tempfile
import time
import xmlrpc.client

CHAIN = 10         # bodies, and number of rods
ROD = 0.5          # [m]
APART = 1.0        # distance between chains [m]
TIME_STEP = 0.001  # [s]
RATE = 50.0        # [Hz]
WARM_UP = 2.0      # until all are connected and have had the first, full messages [s]
TOPICS = ("/tf", "/constraint_sim/markers", "/constraint_sim/body_states",
          "/constraint_sim/constraint_states")
CALLS = 1000       # number of service calls
TIMEOUT = 120.0    # for any start or end, also under valgrind on a busy machine [s]
ROUNDS = 50        # number of counted messages
# Latched topics, published once for each change of the scene, and the check for subscribers of markers.
NOT_COUNTED = "plan|static_transforms|clock|markers"


def write_scene(path, bodies):
    with open(path, "w") as file:
        file.write("world: {time_step: %g}\nbodies:\n" % TIME_STEP)
        for i in range(bodies):
            file.write("  - {name: b%d, shape: {sphere: {radius: 0.1}}, mass: 1, "
                       "position: [%g, %g, 0]}\n" % (i, (i % CHAIN + 1) * ROD, i // CHAIN * APART))
        file.write("constraints:\n")
        for i in range(bodies):
            start = ("anchor_a: [0, %g, 0]" % (i // CHAIN * APART) if i % CHAIN == 0
                     else "body_a: b%d" % (i - 1))
            file.write("  - {name: r%d, %s, body_b: b%d}\n" % (i, start, i))


def free_port():
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def running(command):
    """Runs a command until the block ends, then interrupts it and waits."""
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(timeout=TIMEOUT)


def wait_until(condition, what):
    end = time.monotonic() + TIMEOUT
    while time.monotonic() < end:
        with contextlib.suppress(OSError, xmlrpc.client.Error):
            if condition():
                return
        time.sleep(0.1)
    raise SystemExit("node_throughput: waited in vain for " + what)


def cpu_seconds(pid):
    """Returns the processor time of a process so far, all its threads."""
    total = 0
    for task in os.listdir("/proc/%d/task" % pid):
        with open("/proc/%d/task/%s/schedstat" % (pid, task)) as file:
            total += int(file.read().split()[0])
    return 1e-9 * total


def listen(duration, results):
    """Subscribes to all topics, and puts the node's statistics of the duration into results."""
    import rospy
    from constraint_sim.msg import Statistics

    rospy.init_node("listener")
    statistics, messages = [], []
    rospy.Subscriber("/constraint_sim/statistics", Statistics,
                     lambda message: statistics.append((time.monotonic(), message)))
    for topic in TOPICS:
        # raw bytes: deserializing in Python would cost more than all the rest
        rospy.Subscriber(topic, rospy.AnyMsg, lambda _: messages.append(None))
    wait_until(lambda: statistics, "the node's statistics")
    time.sleep(WARM_UP)

    address = rospy.get_master().lookupNode("/constraint_sim")[2]
    pid = xmlrpc.client.ServerProxy(address).getPid("/listener")[2]
    start, cpu, received = time.monotonic(), cpu_seconds(pid), len(messages)
    time.sleep(duration)
    wall, cpu, received = time.monotonic() - start, cpu_seconds(pid) - cpu, len(messages) - received

    (first_time, first), *rest = [item for item in statistics if item[0] >= start]
    last_time, last = rest[-1]
    ticks = last.step - first.step
    results.put({
        "ticks": ticks,
        "dropped": last.dropped_ticks - first.dropped_ticks,
        "tick_ms": 1e3 * sum(s.wall_mean * s.ticks for _, s in rest) / max(ticks, 1),
        "real_time": (last.sim_time - first.sim_time).to_sec() / (last_time - first_time),
        "rate": received / len(TOPICS) / wall,
        "cpu": cpu / wall,
    })


@contextlib.contextmanager
def node(bodies, *parameters, prefix=""):
    """Starts a master, and a node with that many bodies; yields its scene and its process number."""
    with tempfile.TemporaryDirectory() as folder:
        port = free_port()
        os.environ.update(ROS_MASTER_URI="http://localhost:%d" % port, ROS_HOME=folder,
                          ROS_HOSTNAME="localhost")
        scene = folder + "/scene.yaml"
        write_scene(scene, bodies)
        master = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
        with running(["roscore", "-p", str(port)]):
            wait_until(lambda: master.getPid("/node_throughput"), "the master")
            with running(["rosrun", "--prefix", prefix, "constraint_sim", "constraint_sim_node",
                          "_scene:=" + scene, "_publish_rate:=%g" % RATE, *parameters]):
                wait_until(lambda: master.lookupNode("/node_throughput", "/constraint_sim")[0] == 1,
                           "the node")
                address = master.lookupNode("/node_throughput", "/constraint_sim")[2]
                yield scene, xmlrpc.client.ServerProxy(address).getPid("/node_throughput")[2]


def in_process(function, *arguments):
    """Returns the value that the function puts into its last argument, a queue: rospy can be initialised
    once per process."""
    results = multiprocessing.Queue()
    process = multiprocessing.Process(target=function, args=(*arguments, results))
    process.start()
    try:
        return results.get(timeout=arguments[0] + 3 * TIMEOUT)
    finally:
        process.terminate()
        process.join()


def measure(bodies, duration):
    with node(bodies):
        return in_process(listen, duration)


def steps_and_calls(duration, pid, results):
    """Measures steps and processor time of a node without subscribers, and the times of calls."""
    import rospy
    from constraint_sim.msg import Statistics
    from constraint_sim.srv import GetWorldProperties

    rospy.init_node("caller")
    get = rospy.ServiceProxy("/constraint_sim/get_world_properties", GetWorldProperties,
                             persistent=True)
    rospy.wait_for_service("/constraint_sim/get_world_properties", TIMEOUT)
    get()
    time.sleep(WARM_UP)
    start, begun = cpu_seconds(pid), get().sim_time
    time.sleep(duration)
    cpu, ticks = cpu_seconds(pid) - start, (get().sim_time - begun) / TIME_STEP
    # the first message covers all ticks so far
    step = rospy.wait_for_message("/constraint_sim/statistics", Statistics, TIMEOUT).wall_mean

    results.put({"tick": 1e6 * cpu / ticks, "step": 1e6 * step, "ticks": ticks,
                 "calls": call_times()})


def calls(_, results):
    import rospy

    rospy.init_node("caller")
    rospy.wait_for_service("/constraint_sim/set_motor_bias", TIMEOUT)
    results.put(call_times())


def call_times():
    """Measures set_motor_bias: median, and the bound of 99 of 100 calls [ms]."""
    import rospy
    from constraint_sim.srv import SetMotorBias

    edit = rospy.ServiceProxy("/constraint_sim/set_motor_bias", SetMotorBias, persistent=True)
    times = []
    for _ in range(CALLS):
        time.sleep(0.003)
        begin = time.monotonic()
        if not edit(constraint="r0", bias=0.0).success:
            raise SystemExit("node_throughput: set_motor_bias failed")
        times.append(1e3 * (time.monotonic() - begin))
    times.sort()
    return times[len(times) // 2], times[int(0.99 * len(times))]


def runner_seconds_a_step(scene, steps):
    with tempfile.TemporaryDirectory() as folder:
        report = folder + "/report.json"
        subprocess.run(["rosrun", "constraint_sim", "constraint_sim_run", scene, "--duration",
                        str(steps * TIME_STEP), "--report", report], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with open(report) as file:
            return json.load(file)["wall_time"] / steps


def print_overhead(bodies, duration):
    with node(bodies) as (scene, pid):
        silent = in_process(steps_and_calls, duration, pid)
        engine = min(runner_seconds_a_step(scene, round(silent["ticks"])) for _ in range(3))
    listened = measure(bodies, duration)
    with node(bodies, "_paused:=true") as (_, pid):
        time.sleep(WARM_UP)
        start = cpu_seconds(pid)
        time.sleep(duration)
        paused = (cpu_seconds(pid) - start) / duration
        paused_calls = in_process(calls, duration)
    print("%d bodies on %d rods, tick %g s, %g rounds a second, %d processors" %
          (bodies, bodies, TIME_STEP, RATE, os.cpu_count()))
    print("nobody listens: %.1f us of processor a tick, of which the engine %.1f, so the node "
          "takes %.1f; the same steps in the runner %.1f" %
          (silent["tick"], silent["step"], silent["tick"] - silent["step"], 1e6 * engine))
    print("all topics listened to: %.1f %% of a core, %d dropped ticks" %
          (100 * listened["cpu"], listened["dropped"]))
    print("set_motor_bias, median and what 99 of 100 are below: %.2f, %.2f ms while running; "
          "%.2f, %.2f ms while paused, when no step is waited for" % (silent["calls"] + paused_calls))
    print("paused: %.2f %% of a core" % (100 * paused))


def wait_for_rounds(rounds, results):
    """Subscribes to all topics until that many messages have arrived for each."""
    import rospy

    rospy.init_node("listener")
    messages = []
    for topic in TOPICS:
        rospy.Subscriber(topic, rospy.AnyMsg, lambda _: messages.append(None))
    wait_until(lambda: len(messages) >= rounds * len(TOPICS), "messages")
    results.put(len(messages))


def instructions_for_messages(listens, *parameters):
    """Returns instructions by function of the node, for building messages of bodies and constraints; and
    the messages."""
    messages = 0
    with tempfile.TemporaryDirectory() as folder:
        profile = folder + "/profile"
        valgrind = "valgrind --tool=callgrind --compress-strings=no --callgrind-out-file=" + profile
        with node(10, *parameters, prefix=valgrind):
            if listens:
                messages = in_process(wait_for_rounds, ROUNDS)
            else:
                time.sleep(5.0)
        counts, counted, is_call = {}, "", False
        with open(profile) as file:
            for line in file:
                if line.startswith("fn="):
                    found = re.search(r"constraint_sim::(?:to_(?:msg|transform)|(?:Markers|Labels)::update|"
                                      r"Publishers::publish_(?!%s)\w+)" % NOT_COUNTED, line)
                    counted = found.group(0) if found else ""
                elif line.startswith("calls="):
                    is_call = True
                elif line[0] in "0123456789+-*":
                    if counted and not is_call:
                        counts[counted] = counts.get(counted, 0) + int(line.split()[1])
                    is_call = False
    return counts, messages


def print_counts():
    silent, _ = instructions_for_messages(False)
    paused, _ = instructions_for_messages(False, "_paused:=true")
    heard, messages = instructions_for_messages(True)
    print("instructions for %d messages that are heard, in 5 s without a listener, and paused" % messages)
    for function in sorted(heard):
        print("%-60s %12d %12d %12d" % (function, heard[function], silent.get(function, 0),
                                        paused.get(function, 0)))
    if messages == 0 or not heard or any(silent.values()) or any(paused.values()):
        raise SystemExit("node_throughput: messages were built for nobody, or none for somebody")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bodies", type=int, nargs="*", default=[100, 300, 1000, 3000],
                        help="numbers of bodies to try, each with as many rods")
    parser.add_argument("--duration", type=float, default=10.0, metavar="SECONDS",
                        help="wall time that is measured")
    parser.add_argument("--overhead", action="store_true",
                        help="what the node takes beyond the engine, at 100 bodies")
    parser.add_argument("--count", action="store_true",
                        help="that no message is built for nobody, by callgrind")
    arguments = parser.parse_args()
    if arguments.count:
        print_counts()
        return
    if arguments.overhead:
        print_overhead(100, arguments.duration)
        return

    print("tick %g s, %g rounds of messages per second, %d processors" %
          (TIME_STEP, RATE, os.cpu_count()))
    print("bodies  rods  ticks done  dropped  tick [ms]  real-time factor  rounds [1/s]  CPU")
    carried = []
    for bodies in arguments.bodies:
        result = measure(bodies, arguments.duration)
        print("{0:6d}{0:6d}{ticks:12d}{dropped:9d}{tick_ms:11.3f}{real_time:18.3f}{rate:14.1f}"
              "{cpu:5.0%}".format(bodies, **result), flush=True)
        if result["dropped"] == 0:
            carried.append(bodies)
    print("the most without a dropped tick: %s" % (max(carried) if carried else "none"))


if __name__ == "__main__":
    main()
