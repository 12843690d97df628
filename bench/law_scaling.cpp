// Prints the run time of a step of chains and nets with many laws, by event_driven and by
// sequential_impulses, and their errors: the largest difference of a position to that of
// event_driven at half the time step.
//
//   constraint_sim_law_scaling

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "make_scene.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kTimeStep = 0.01, kDuration = 0.3;  // [s]

/// Bars end to end, on hinges with friction and axes across each other, which fall from a line.
void add_bars(int count, World* world) {
  BodyId before = kWorldBody;
  for (int i = 0; i < count; ++i) {
    Body bar = make_body("bar_" + std::to_string(i), Box{{0.09, 0.01, 0.01}}, 1.0,
                         {0.1 * (i + 0.5), 0.0, 0.0});
    bar.no_collision = true;
    const BodyId id = world->add_body(bar);
    Joint hinge = make_joint("hinge_" + std::to_string(i), before, {i > 0 ? 0.05 : 0.0, 0.0, 0.0},
                             id, {-0.05, 0.0, 0.0}, JointKind::kHinge);
    hinge.frame_a = frame_along(i % 2 == 0 ? Vector3d::UnitY() : Vector3d::UnitZ());
    hinge.coordinates[0].friction = 0.1;
    world->add_joint(hinge);
    before = id;
  }
}

/// Balls on a grid, the corners of the first row held, with ropes between neighbours.
void add_net(int rows, int columns, World* world) {
  std::vector<BodyId> balls;
  const auto at = [](int row, int column) { return Vector3d(0.1 * column, 0.1 * row, 0.0); };
  const auto join = [&](BodyId a, BodyId b) {
    const std::string name = "rope_" + std::to_string(world->joint_ids().size());
    world->add_joint(make_joint(name, a, Vector3d::Zero(), b, Vector3d::Zero(), rope(0.102)));
  };
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      Body ball =
          make_body("ball_" + std::to_string(balls.size()), Sphere{0.1}, 0.01, at(row, column));
      ball.no_collision = true;
      balls.push_back(world->add_body(ball));
      if (column > 0) join(balls[balls.size() - 2], balls.back());
      if (row > 0) join(balls[balls.size() - 1 - static_cast<std::size_t>(columns)], balls.back());
    }
  for (const int column : {0, columns - 1})
    world->add_joint(make_joint("pin_" + std::to_string(column), kWorldBody, at(0, column),
                                balls[static_cast<std::size_t>(column)], Vector3d::Zero(),
                                JointKind::kBall));
}

struct Run {
  double time_of_a_step;  ///< [ms]
  Method method;          ///< method of the first island, after the last step
  std::vector<Vector3d> positions;
};

Run run(const std::function<void(World*)>& add, Method method, double time_step) {
  WorldOptions options;
  options.method = method;
  options.time_step = time_step;
  World world(options);
  add(&world);
  const int steps = static_cast<int>(kDuration / time_step + 0.5);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < steps; ++i) world.step();
  const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
  Run result{1e3 * time.count() / steps, world.islands().front().method, {}};
  for (const BodyId id : world.body_ids()) result.positions.push_back(world.state(id).position);
  return result;
}

double difference(const Run& a, const Run& b) {
  double most = 0.0;
  for (std::size_t i = 0; i < a.positions.size(); ++i)
    most = std::max(most, (a.positions[i] - b.positions[i]).norm());
  return most;
}

void print(const char* scene, int laws, const std::function<void(World*)>& add) {
  const Run by_events = run(add, Method::kAuto, kTimeStep);
  if (by_events.method != Method::kEventDriven) {
    std::printf("| %s | %d | left to impulses | %.2f | | | |\n", scene, laws,
                by_events.time_of_a_step);
    return;
  }
  const Run half = run(add, Method::kAuto, 0.5 * kTimeStep);
  const Run stepped = run(add, Method::kSequentialImpulses, kTimeStep);
  std::printf("| %s | %d | %.2f | %.2f | %.2f | %.0e | %.0e |\n", scene, laws,
              by_events.time_of_a_step, stepped.time_of_a_step,
              by_events.time_of_a_step / stepped.time_of_a_step, difference(by_events, half),
              difference(stepped, half));
  std::fflush(stdout);
}

}  // namespace
}  // namespace constraint_sim::engine

int main() {
  using namespace constraint_sim::engine;
  std::printf(
      "| scene | laws | event_driven [ms] | sequential_impulses [ms] | ratio | error [m] | of "
      "sequential_impulses [m] |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n");
  for (const int bars : {4, 16, 32, 64, 120})
    print("bars on hinges with friction", bars, [=](World* world) { add_bars(bars, world); });
  for (const int balls : {4, 16, 60, 100})
    print("chain of ropes", balls - 1, [=](World* world) { add_net(1, balls, world); });
  for (const int side : {2, 3, 4, 6})
    print("net of ropes", 2 * side * (side - 1), [=](World* world) { add_net(side, side, world); });
  return 0;
}
