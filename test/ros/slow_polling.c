// A library to preload: delays the thread of roscpp that polls its sockets, and the threads that
// write responses, so that PollSet of roscpp 1.15 closes new connections for the events of closed
// ones in one of five calls (src/ros/poll_pause.h).
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

static pthread_t polling;

int epoll_wait(int set, struct epoll_event* events, int most, int timeout) {
  int (*const real)(int, struct epoll_event*, int, int) = dlsym(RTLD_NEXT, "epoll_wait");
  polling = pthread_self();
  usleep(1000);  // several events come together
  const int count = real(set, events, most, timeout);
  if (count > 1) usleep(2000);  // others close their sockets meanwhile
  return count;
}

ssize_t send(int socket, const void* bytes, size_t count, int flags) {
  ssize_t (*const real)(int, const void*, size_t, int) = dlsym(RTLD_NEXT, "send");
  const ssize_t sent = real(socket, bytes, count, flags);
  if (!pthread_equal(polling, pthread_self())) usleep(2000);  // the peer hangs up first
  return sent;
}
