// Cost of a step from 10 links, bodies or contacts on: run time and memory, as CSV.
//
//   constraint_sim_scaling [MOST]              sizes up to MOST, 100000 unless given
//   constraint_sim_scaling KIND COUNT STEPS    nothing but these steps, to count their instructions

#include <malloc.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

#include "problems.h"

namespace constraint_sim::engine {
namespace {

double allocated_bytes() {
#if __GLIBC_PREREQ(2, 33)
  const struct mallinfo2 info = mallinfo2();
#else
  const struct mallinfo info = mallinfo();
#endif
  return static_cast<double>(info.uordblks + info.hblkhd);
}

World links(int count) { return problems::chain(count); }

World bodies(int count) {
  World world;
  for (int i = 0; i < count; ++i) {
    Body body;
    body.name = "box_" + std::to_string(i);
    body.mass = 1.0;
    body.inertia = {0.1, 0.2, 0.3};
    body.state.position.x() = 3.0 * i;
    body.state.angular_velocity = {1.0, 2.0, 3.0};
    world.add_body(body);
  }
  return world;
}

/// Balls at rest on a plane, one contact each.
World contacts(int count) {
  World world;
  Body plane;
  plane.name = "plane";
  plane.type = BodyType::kStatic;
  plane.shape = Plane{};
  plane.friction = 0.5;
  world.add_body(plane);
  for (int i = 0; i < count; ++i) {
    Body ball;
    ball.name = "ball_" + std::to_string(i);
    ball.shape = Sphere{0.5};
    ball.mass = 1.0;
    ball.friction = 0.5;
    ball.state.position = {2.0 * (i % 300), 2.0 * std::floor(i / 300.0), 0.5};
    world.add_body(ball);
  }
  return world;
}

struct Kind {
  const char* name;
  World (*make)(int);
};
constexpr Kind kKinds[] = {{"links", links}, {"bodies", bodies}, {"contacts", contacts}};

World warm(const Kind& kind, int count) {
  constexpr int kWarmUp = 5;
  World world = kind.make(count);
  WorldOptions options = world.options();
  options.time_step = 1e-3;
  options.tolerance = 0.0;
  world.set_options(options);
  for (int i = 0; i < kWarmUp; ++i) world.step();
  return world;
}

/// Of this process [µs]; others may use the machine meanwhile.
double processor_time() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

void print(const Kind& kind, int count) {
  const double before = allocated_bytes();
  World world = warm(kind, count);
  const double bytes = allocated_bytes() - before;
  const int steps = std::max(3, 50000 / count);
  double best = 1e300;
  for (int repetition = 0; repetition < 5; ++repetition) {
    const double start = processor_time();
    for (int i = 0; i < steps; ++i) world.step();
    best = std::min(best, (processor_time() - start) / steps);
  }
  std::printf("%s,%d,%.4g,%.4g\n", kind.name, count, best, bytes);
  std::fflush(stdout);
}

}  // namespace
}  // namespace constraint_sim::engine

int main(int argc, char** argv) {
  using namespace constraint_sim::engine;
  if (argc == 4) {
    for (const Kind& kind : kKinds) {
      if (std::strcmp(kind.name, argv[1]) != 0) continue;
      World world = warm(kind, std::atoi(argv[2]));
      for (int i = 0; i < std::atoi(argv[3]); ++i) world.step();
      return 0;
    }
    return 2;
  }
  const int most = argc > 1 ? std::atoi(argv[1]) : 100000;
  std::printf("kind,count,time,bytes\n");
  for (int count = 10; count <= most; count *= 10)
    for (const Kind& kind : kKinds) print(kind, count);
  return 0;
}
