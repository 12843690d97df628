#pragma once

#include <cstdint>
#include <queue>

#include "constraint_sim/engine/event.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Spheres without friction that keep all of their energy when they hit each other or planes, any
/// number of them: between two hits each goes along its parabola and turns as it does, in closed
/// form, so that a queue of the times at which pairs will hit carries them from hit to hit. Nothing
/// is kept from one span to the next but what was told.
class ElasticSpheres {
 public:
  struct Sphere {
    int body;  ///< of the world
    double mass, radius;
  };
  struct Plane {
    int body;
    Eigen::Vector3d normal, point;
  };
  struct Hit {
    double time;              ///< simulated [s]
    int a, b;                 ///< bodies of the world, a sphere first
    Eigen::Vector3d impulse;  ///< on A [N s]
  };
  static constexpr std::uint32_t kMostHits = 200;  ///< of a sphere in a step, on the mean

  /// One that is faster than `most_speed` [m/s] may meet what is no part of this.
  ElasticSpheres(List<Sphere> spheres, List<Plane> planes, double most_speed)
      : spheres_(std::move(spheres)), planes_(std::move(planes)), most_speed_(most_speed) {}

  /// False where two overlap by more than `most` [m], or one is at rest on what it lies on: that is
  /// for others.
  bool begin(const List<BodyState>& states, double most);
  /// As method.h says. Not done: too many hits, as of spheres that come to lie, or one too fast.
  IntegrationResult advance(const SmoothSpan& span, List<BodyState>* states);

  const List<Hit>& hits() const { return hits_; }
  const List<Sphere>& spheres() const { return spheres_; }
  const List<Plane>& planes() const { return planes_; }

 private:
  /// Where a sphere was at a time, and how fast.
  struct Flight {
    Eigen::Vector3d x, v;
    double since = 0.0;         ///< [s] from the start of the span
    std::uint32_t version = 0;  ///< what was expected of an earlier one does not come
  };
  struct Expected {
    double time;
    std::size_t a, b;  ///< spheres, and planes after these
    std::uint32_t version_a, version_b;

    bool operator<(const Expected& other) const {  // the earliest is on top, then by number
      if (time != other.time) return time > other.time;
      return a != other.a ? a > other.a : b > other.b;
    }
  };

  Eigen::Vector3d place(const Flight& flight, double t) const;
  Eigen::Vector3d velocity(const Flight& flight, double t) const {
    return flight.v + (t - flight.since) * gravity_;
  }
  double time_to_sphere(std::size_t a, std::size_t b, double now) const;
  double time_to_plane(std::size_t a, const Plane& plane, double now) const;
  void expect(std::size_t a, std::size_t b, double now);
  void expect_all(std::size_t a, double now);
  void have_hit(const Expected& hit, double start);

  List<Sphere> spheres_;
  List<Plane> planes_;
  double most_speed_;
  List<Flight> flights_;
  Eigen::Vector3d gravity_;
  double end_ = 0.0;  // of the span, from its start
  std::priority_queue<Expected> expected_;
  List<Hit> hits_;
};

}  // namespace constraint_sim::engine
