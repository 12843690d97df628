#pragma once

#include <cstdint>
#include <queue>

#include "constraint_sim/engine/event.h"
#include "engine/dynamics/method.h"
#include "engine/math/integrate.h"
#include "engine/math/list.h"

namespace constraint_sim::engine {

/// Spheres without friction and energy loss that hit each other or planes, in any number. Between
/// hits each sphere moves on its parabola and rotates in closed form; a queue of predicted hits of
/// pairs advances the spheres from hit to hit. Between intervals only the reported hits are kept.
class ElasticSpheres {
 public:
  struct Sphere {
    int body;  ///< index in the world
    double mass, radius;
  };
  struct Plane {
    int body;
    Eigen::Vector3d normal, point;
  };
  struct Hit {
    double time;              ///< simulated [s]
    int a, b;                 ///< indices in the world; a is a sphere
    Eigen::Vector3d impulse;  ///< impulse on A [N s]
  };
  /// Most hits per sphere in a step, on average.
  static constexpr std::uint32_t kMostHitsPerSphere = 200;

  /// Spheres faster than `most_speed` [m/s] may meet bodies outside this group.
  ElasticSpheres(List<Sphere> spheres, List<Plane> planes, double most_speed)
      : spheres_(std::move(spheres)), planes_(std::move(planes)), most_speed_(most_speed) {}

  /// Returns false where two bodies overlap by more than `most` [m], or a sphere rests on another
  /// body; these cases need another method.
  bool begin(const List<BodyState>& states, double most);
  /// Advances the spheres as IntervalMethod describes, exactly whatever the options. Gives up after
  /// too many hits, as of spheres that come to rest, or where a sphere is too fast.
  IntegrationResult advance(const Interval& interval, const IntegratorOptions& options,
                            List<BodyState>* states);

  const List<Hit>& hits() const { return hits_; }
  const List<Sphere>& spheres() const { return spheres_; }
  const List<Plane>& planes() const { return planes_; }

 private:
  /// Parabola of a sphere: position and velocity at the time `since`.
  struct Flight {
    Eigen::Vector3d x, v;
    double since = 0.0;         ///< time from the start of the interval [s]
    std::uint32_t version = 0;  ///< hits predicted for an earlier version are void
  };
  struct Expected {
    double time;
    std::size_t a, b;  ///< indices of spheres; planes are numbered after spheres
    std::uint32_t version_a, version_b;

    bool operator<(const Expected& other) const {  // earliest on top, then by number
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
  double end_ = 0.0;  // end of the interval, from its start [s]
  std::priority_queue<Expected> expected_;
  List<Hit> hits_;
};
static_assert(IntervalMethod<ElasticSpheres>::kIsHeld);

}  // namespace constraint_sim::engine
