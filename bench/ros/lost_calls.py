#!/usr/bin/env python3
"""Counts service calls that roscpp loses: a plain roscpp server, called over raw TCPROS connections.

Builds the server, which only answers `true`, from the text below. Each row is a way of calling: a connection per
call, as rospy.ServiceProxy and rosservice make it, by six clients and by one; persistent connections; and a
connection per call while test/ros/slow_polling.c widens the gap in which roscpp loses calls. The last rows are of a
server that answers within the node's PollPause. A call is lost where the server closes the connection before the
response is complete; "served" is the number of calls that reached the server's callback.

    bench/ros/lost_calls.py --seconds 10
"""
import argparse
import multiprocessing
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import xmlrpc.client

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from node_throughput import free_port, running, wait_until  # noqa: E402

SERVER = r"""
#include <ros/ros.h>
#include <std_srvs/SetBool.h>
#include <atomic>
#ifdef PAUSES
#include "ros/service_queue.h"
#endif
using Spec = ros::ServiceSpec<std_srvs::SetBool::Request, std_srvs::SetBool::Response>;
std::atomic<unsigned> served{0};
bool serve(std_srvs::SetBool::Request&, std_srvs::SetBool::Response& response) {
  ++served;
  return response.success = true;
}
int main(int argc, char** argv) {
  ros::init(argc, argv, "plain");
#ifdef PAUSES
  constraint_sim::ServiceQueue queue(2);
  ros::NodeHandle handle = queue.serving(ros::NodeHandle());
  queue.start();
#else
  ros::NodeHandle handle;
  ros::AsyncSpinner spinner(2);
  spinner.start();
#endif
  ros::AdvertiseServiceOptions options;
  options.initBySpecType<Spec>("plain", serve);
#ifdef PAUSES
  options.helper = boost::make_shared<constraint_sim::PausingCalls<Spec>>(serve);
#endif
  const ros::ServiceServer server = handle.advertiseService(options);
  ros::waitForShutdown();
  std::printf("%u\n", served.load());
}
"""
ROOT = pathlib.Path(__file__).resolve().parents[2]


def field(text):
    return struct.pack("<I", len(text)) + text.encode()


def receive(connection, count):
    received = b""
    while len(received) < count:
        part = connection.recv(count - len(received))
        if not part:
            raise EOFError
        received += part
    return received


def receive_sized(connection):
    return receive(connection, struct.unpack("<I", receive(connection, 4))[0])


def connect(port, is_persistent):
    header = b"".join(field(each) for each in (
        "callerid=/raw", "service=/plain", "md5sum=*", "type=std_srvs/SetBool",
        "persistent=%d" % is_persistent))
    connection = socket.create_connection(("localhost", port))
    connection.sendall(struct.pack("<I", len(header)) + header)
    receive_sized(connection)
    return connection


def call_until(end, port, is_persistent, results):
    """Calls one after another; puts the numbers of calls and of lost calls into results."""
    calls, lost, connection = 0, 0, None
    while time.monotonic() < end:
        calls += 1
        try:
            connection = connection or connect(port, is_persistent)
            connection.sendall(struct.pack("<IB", 1, 1))
            receive(connection, 1)
            receive_sized(connection)
            if not is_persistent:
                connection.close()
                connection = None
        except (EOFError, OSError):
            lost += 1
            connection = None
    results.put((calls, lost))


def build(program, options):
    """Compiles the server."""
    flags = subprocess.check_output(["pkg-config", "--cflags", "--libs", "roscpp", "std_srvs"],
                                    universal_newlines=True).split()
    subprocess.run(["g++", "-std=c++17", "-O1", "-pthread", "-x", "c++", "-", "-o", program, "-x", "none",
                    *options, *flags], input=SERVER, universal_newlines=True, check=True)


def row(master, program, seconds, clients, is_persistent=False, preload="", note=""):
    environment = dict(os.environ, LD_PRELOAD=preload)
    server = subprocess.Popen([program], env=environment, stdout=subprocess.PIPE, universal_newlines=True)
    address = []

    def is_there():
        code, _, uri = master.lookupService("/lost", "/plain")
        address[:] = [uri]
        return code == 1 and master.lookupNode("/lost", "/plain")[0] == 1
    wait_until(is_there, "the server")
    port = int(address[0].rsplit(":", 1)[1])
    results = multiprocessing.Queue()
    end = time.monotonic() + seconds
    workers = [multiprocessing.Process(target=call_until, args=(end, port, is_persistent, results))
               for _ in range(clients)]
    for worker in workers:
        worker.start()
    counts = [results.get() for _ in workers]
    for worker in workers:
        worker.join()
    server.send_signal(signal.SIGINT)
    served = int(server.communicate()[0])
    print("%d clients, %s connections%s%s: %d calls, %d lost, %d served" % (
        clients, "persistent" if is_persistent else "single", ", slowed" if preload else "", note,
        sum(calls for calls, _ in counts), sum(lost for _, lost in counts), served), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="for each row; default: 10")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        port = free_port()
        os.environ.update(ROS_MASTER_URI="http://localhost:%d" % port, ROS_HOME=folder,
                          ROS_HOSTNAME="localhost")
        plain, pausing, slowing = folder + "/plain", folder + "/pausing", folder + "/slow_polling.so"
        build(plain, [])
        build(pausing, ["-DPAUSES", "-I" + str(ROOT / "src"), str(ROOT / "src/ros/poll_pause.cpp")])
        subprocess.check_call(["gcc", "-shared", "-fPIC", str(ROOT / "test/ros/slow_polling.c"), "-o", slowing,
                               "-ldl"])
        master = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
        with running(["roscore", "-p", str(port)]):
            wait_until(lambda: master.getPid("/lost"), "the master")
            row(master, plain, options.seconds, 6)
            row(master, plain, options.seconds, 1)
            row(master, plain, options.seconds, 6, is_persistent=True)
            row(master, plain, options.seconds, 6, preload=slowing)
            row(master, pausing, options.seconds, 6, note=", paused")
            row(master, pausing, options.seconds, 6, is_persistent=True, note=", paused")
            row(master, pausing, options.seconds, 6, preload=slowing, note=", paused")


if __name__ == "__main__":
    main()
