// Scenes of growing size, to measure run time and memory per element.

#include <algorithm>

#include "common.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

/// A problem with five samples to warm up, in which contacts form and memory grows, and five that
/// count, of up to twenty ticks for small sizes.
Problem sized(const std::string& group, int count) {
  constexpr double kTick = 1e-3;
  constexpr int kSamples = 5;
  const int ticks = std::clamp(200 / count, 1, 20);
  Problem made = problem("", group, 2 * kSamples * ticks * kTick, count);
  made.is_graded = false;
  made.sample = ticks * kTick;
  made.warm_up = kSamples;
  return made;
}

/// Links of a chain that is released level.
Problem links(int count) {
  Problem made = sized("links", count);
  add_chain(chain_of(count), &made);
  return made;
}

/// Tumbling boxes beside each other in free fall.
Problem bodies(int count) {
  Problem made = sized("bodies", count);
  made.is_planar = false;
  for (int i = 0; i < count; ++i) {
    Body body = box(1.0, {0.1, 0.4, 0.9});
    body.start.position.x() = 3.0 * i;
    body.start.angular_velocity = {1.0, 2.0, 3.0};
    made.bodies.push_back(body);
  }
  return made;
}

/// Balls at rest on a plane, each with one contact with friction.
Problem contacts(int count) {
  constexpr double kFriction = 0.5;
  Problem made = sized("contacts", count);
  made.is_planar = false;
  made.bodies.push_back(plane(kFriction, 0.0));
  for (int i = 0; i < count; ++i)
    made.bodies.push_back(
        ball(1.0, 0.5, {2.0 * (i % 300), 2.0 * std::floor(i / 300.0), 0.5}, kFriction));
  return made;
}

const Registration kLinks("links", links), kBodies("bodies", bodies),
    kContacts("contacts", contacts);

}  // namespace
}  // namespace constraint_sim::report
