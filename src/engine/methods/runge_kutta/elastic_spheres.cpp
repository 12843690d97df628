#include "engine/methods/runge_kutta/elastic_spheres.h"

#include <cmath>

#include "engine/math/list.h"
#include "engine/math/numbers.h"
#include "engine/model/mass_properties.h"

namespace constraint_sim::engine {
namespace {

using Eigen::Vector3d;

constexpr double kNever = kInfinity;
constexpr double kLowest = 1e-10;  // [m] height of a bounce; a sphere with lower bounces rests

/// Time until the gap g + v t + a t²/2 falls to 0, where it is open or closed at first; kNever
/// where it stays open.
double time_to_close(double gap, double rate, double acceleration) {
  if (rate < 0.0) {
    if (gap <= 0.0) return 0.0;
    const double root = rate * rate - 2.0 * acceleration * gap;
    return root < 0.0 ? kNever : 2.0 * gap / (-rate + std::sqrt(root));
  }
  if (acceleration >= 0.0) return kNever;
  const double root = rate * rate - 2.0 * acceleration * std::max(gap, 0.0);
  return (rate + std::sqrt(root)) / -acceleration;
}

}  // namespace

// ---- flight

Vector3d ElasticSpheres::place(const Flight& flight, double t) const {
  const double since = t - flight.since;
  return flight.x + since * (flight.v + 0.5 * since * gravity_);
}

// Time of the hit of two spheres. All spheres fall alike, and so move past each other on straight
// lines.
double ElasticSpheres::time_to_sphere(std::size_t a, std::size_t b, double now) const {
  const Vector3d d = place(flights_[a], now) - place(flights_[b], now);
  const Vector3d w = velocity(flights_[a], now) - velocity(flights_[b], now);
  const double approach = d.dot(w);
  if (!(approach < 0.0)) return kNever;
  const double reach = spheres_[a].radius + spheres_[b].radius;
  const double apart = d.squaredNorm() - reach * reach;
  if (apart <= 0.0) return now;
  const double root = approach * approach - w.squaredNorm() * apart;
  return root < 0.0 ? kNever : now + apart / (-approach + std::sqrt(root));
}

double ElasticSpheres::time_to_plane(std::size_t a, const Plane& plane, double now) const {
  const double gap = plane.normal.dot(place(flights_[a], now) - plane.point) - spheres_[a].radius;
  return now + time_to_close(gap, plane.normal.dot(velocity(flights_[a], now)),
                             plane.normal.dot(gravity_));
}

void ElasticSpheres::expect(std::size_t a, std::size_t b, double now) {
  const std::size_t n = spheres_.size();
  const double time = b < n ? time_to_sphere(a, b, now) : time_to_plane(a, planes_[b - n], now);
  if (time <= end_)
    expected_.push({time, a, b, flights_[a].version, b < n ? flights_[b].version : 0});
}

void ElasticSpheres::expect_all(std::size_t a, double now) {
  const std::size_t n = spheres_.size();
  for (std::size_t b = 0; b < n; ++b)
    if (b != a) expect(std::min(a, b), std::max(a, b), now);
  for (std::size_t p = 0; p < planes_.size(); ++p) expect(a, n + p, now);
}

bool ElasticSpheres::begin(const List<BodyState>& states, double most) {
  const auto state_of = [&](const Sphere& sphere) -> const BodyState& {
    return states[static_cast<std::size_t>(sphere.body)];
  };
  for (std::size_t a = 0; a < spheres_.size(); ++a) {
    const Vector3d& x = state_of(spheres_[a]).position;
    for (std::size_t b = 0; b < a; ++b) {
      const double reach = spheres_[a].radius + spheres_[b].radius - most;
      if ((x - state_of(spheres_[b]).position).squaredNorm() < reach * reach) return false;
    }
    for (const Plane& plane : planes_)
      if (plane.normal.dot(x - plane.point) - spheres_[a].radius < -most) return false;
  }
  return true;
}

// ---- hits

// Reverses the approach velocity along the line of the hit.
void ElasticSpheres::have_hit(const Expected& hit, double start) {
  const std::size_t n = spheres_.size();
  const bool on_plane = hit.b >= n;
  const auto stop_at = [&](std::size_t i) {
    Flight& flight = flights_[i];
    flight.x = place(flight, hit.time);
    flight.v = velocity(flight, hit.time);
    flight.since = hit.time;
    ++flight.version;
  };
  stop_at(hit.a);
  Flight& a = flights_[hit.a];
  if (on_plane) {
    const Plane& plane = planes_[hit.b - n];
    const Vector3d change = -2.0 * plane.normal.dot(a.v) * plane.normal;
    a.v += change;
    hits_.push_back(
        {start + hit.time, spheres_[hit.a].body, plane.body, spheres_[hit.a].mass * change});
    return;
  }
  stop_at(hit.b);
  Flight& b = flights_[hit.b];
  const double m_a = spheres_[hit.a].mass, m_b = spheres_[hit.b].mass;
  const Vector3d normal = (a.x - b.x).normalized();
  const Vector3d impulse = -2.0 * m_a * m_b / (m_a + m_b) * normal.dot(a.v - b.v) * normal;
  a.v += impulse / m_a;
  b.v -= impulse / m_b;
  hits_.push_back({start + hit.time, spheres_[hit.a].body, spheres_[hit.b].body, impulse});
}

IntegrationResult ElasticSpheres::advance(const Interval& interval, const IntegratorOptions&,
                                          List<BodyState>* states) {
  const std::size_t n = spheres_.size();
  const auto state_of = [&](std::size_t i) -> BodyState& {
    return (*states)[static_cast<std::size_t>(spheres_[i].body)];
  };
  gravity_ = interval.gravity;
  end_ = interval.h;
  expected_ = {};
  flights_.clear();
  for (std::size_t i = 0; i < n; ++i)
    flights_.push_back({state_of(i).position, state_of(i).linear_velocity});
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) expect(j, i, 0.0);
    for (std::size_t p = 0; p < planes_.size(); ++p) expect(i, n + p, 0.0);
  }
  IntegrationResult progress;
  progress.substeps = 1;
  const std::size_t most = hits_.size() + kMostHitsPerSphere * n;
  const double lowest = std::sqrt(2.0 * gravity_.norm() * kLowest);
  while (!expected_.empty()) {
    const Expected hit = expected_.top();
    expected_.pop();
    if (hit.version_a != flights_[hit.a].version ||
        (hit.b < n && hit.version_b != flights_[hit.b].version))
      continue;
    have_hit(hit, interval.t);
    const bool lies = hit.b >= n && planes_[hit.b - n].normal.dot(flights_[hit.a].v) <= lowest;
    const bool is_too_fast = flights_[hit.a].v.norm() > most_speed_ ||
                             (hit.b < n && flights_[hit.b].v.norm() > most_speed_);
    if (lies || is_too_fast || hits_.size() > most || is_set(interval.stop)) {
      progress.done = false;
      return progress;
    }
    expect_all(hit.a, hit.time);
    if (hit.b < n) expect_all(hit.b, hit.time);
  }
  for (std::size_t i = 0; i < n; ++i) {
    BodyState& state = state_of(i);
    state.position = place(flights_[i], end_);
    state.linear_velocity = velocity(flights_[i], end_);
    if (!state.angular_velocity.isZero(0.0))
      state.orientation =
          (rotation(end_ * state.angular_velocity) * state.orientation).normalized();
  }
  return progress;
}

}  // namespace constraint_sim::engine
