#include "sim/trajectories.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "engine/math/elementary.h"
#include "engine/math/numbers.h"
#include "engine/model/validate.h"
#include "sim/errors.h"

namespace constraint_sim {
namespace {

// Deviation of a point at the start from the joint's position [m or rad] within which it is the
// joint's state: messages give positions with few digits.
constexpr double kSamePlace = 1e-3;
// Share of a tick by which the places of its first and last rate are inside: rates of splines may
// jump at points, and times are rounded.
constexpr double kInside = 1e-9;

std::string of_joint(const std::string& joint) { return "joint '" + joint + "' "; }

[[noreturn]] void refuse_joints(const std::string& why) {
  throw TrajectoryError(TrajectoryError::Field::kJoints, "joint_names: " + why);
}

void check(const JointTrajectory& trajectory) {
  if (trajectory.joints.empty()) refuse_joints("there are none");
  double before = -1.0;
  for (std::size_t i = 0; i < trajectory.points.size(); ++i) {
    const JointTrajectory::Point& point = trajectory.points[i];
    const std::string field = "points[" + std::to_string(i) + "]";
    if (!(std::isfinite(point.time) && point.time >= 0.0 && point.time > before))
      refuse(field + ".time_from_start",
             "times must be >= 0 and increase, got " + std::to_string(point.time));
    before = point.time;
    if (point.positions.size() != trajectory.joints.size())
      refuse(field + ".positions",
             "must be one for each joint, got " + std::to_string(point.positions.size()));
    for (const auto* values : {&point.velocities, &point.accelerations})
      if (!values->empty() && values->size() != trajectory.joints.size())
        refuse(field, "velocities and accelerations must be one for each joint, or left out");
    for (const auto* values : {&point.positions, &point.velocities, &point.accelerations})
      for (const double value : *values) engine::check_finite(field, value);
  }
}

/// Returns the order of the spline that all points have data for.
int order_of(const JointTrajectory& trajectory) {
  const auto all_have = [&](auto member) {
    return std::all_of(trajectory.points.begin(), trajectory.points.end(), [&](const auto& point) {
      return (point.*member).size() == trajectory.joints.size();
    });
  };
  if (!all_have(&JointTrajectory::Point::velocities)) return 1;
  return all_have(&JointTrajectory::Point::accelerations) ? 5 : 3;
}

/// Returns the motor that follows the trajectory.
const engine::Motor& motor_of(const engine::Joint& joint) {
  if (engine::info(joint.kind).coordinates == 0)
    refuse_joints(of_joint(joint.name) + "has no coordinate");
  if (!joint.coordinates[0].motor)
    refuse_joints(of_joint(joint.name) + "has no motor to follow a trajectory with");
  const engine::Motor& motor = *joint.coordinates[0].motor;
  if (motor.force) refuse_joints(of_joint(joint.name) + "has a motor that goes by force");
  return motor;
}

/// Returns the position within the limits. Joints at a limit are reported a few units of rounding
/// beyond it, as far as which a position is accepted; throws for one farther beyond.
double within_limits(const engine::Joint& joint, double position) {
  constexpr double kRounding = 1e-6;  // [m or rad]
  const engine::CoordinateLaw& law = joint.coordinates[0];
  if (position < law.lower - kRounding || position > law.upper + kRounding)
    refuse("points", of_joint(joint.name) + "goes from " + std::to_string(law.lower) + " to " +
                         std::to_string(law.upper) + ", not to " + std::to_string(position));
  return std::clamp(position, law.lower, law.upper);
}

double present(const engine::Joint& joint, const engine::JointState& state) {
  const engine::CoordinateState& now = state.coordinates[0];
  return joint.coordinates[0].motor->is_servo() ? now.position : now.held;
}

/// Returns the spline of one joint. It begins at `elapsed` [s], the time since the start of a
/// trajectory that is late, with the joint's present state: earlier points are dropped, and so is a
/// point at that time which is elsewhere, as in ros_control.
Spline spline_of(const engine::World& world, engine::JointId id, const JointTrajectory& trajectory,
                 std::size_t k, double elapsed) {
  const engine::Joint& joint = world.joint(id);
  motor_of(joint);
  const engine::JointState& state = world.joint_state(id);
  std::vector<TrajectoryPoint> points{
      {elapsed, present(joint, state), state.coordinates[0].velocity, 0.0}};
  for (const JointTrajectory::Point& given : trajectory.points) {
    TrajectoryPoint point{given.time, within_limits(joint, given.positions[k]), 0.0, 0.0};
    if (!given.velocities.empty()) point.velocity = given.velocities[k];
    if (!given.accelerations.empty()) point.acceleration = given.accelerations[k];
    if (given.time > elapsed) {
      points.push_back(point);
    } else if (given.time == elapsed &&
               std::abs(point.position - points[0].position) <= kSamePlace) {
      points[0].velocity = point.velocity;
      points[0].acceleration = point.acceleration;
    } else if (&given == &trajectory.points.back()) {
      const std::string why = "points: " + of_joint(joint.name) + "is at " +
                              std::to_string(points[0].position) +
                              " and cannot be elsewhere at once, got " +
                              std::to_string(point.position) + " at a time that is not later";
      if (elapsed > 0.0) throw TrajectoryError(TrajectoryError::Field::kStamp, why);
      throw std::invalid_argument(why);
    }
  }
  return {std::move(points), order_of(trajectory)};
}

/// Lets a motor by rate go through a tick that begins at `time` [s] from the rate `begin` to the
/// rate `end`, with this mean [m/s or rad/s]. Rates that jump between ticks would ask for more
/// force than any limited motor has. With x from −1/2 to 1/2 within the tick the rate is v = bias +
/// p cos(κ x) + q sin(κ x), where v(1/2) − v(−1/2) = 2 q sin(κ/2), (v(1/2) + v(−1/2))/2 = bias + p
/// cos(κ/2), and the mean is bias + p sin(κ/2)/(κ/2).
void set_rate(double begin, double mean, double end, double time, double h, engine::Motor* motor) {
  // A joint with friction has no direction where it begins, or comes to rest, without a rate.
  constexpr double kLeast = 0.03;
  const double square_of_mean = mean * mean;
  if (begin * mean < kLeast * square_of_mean && end * mean > square_of_mean) begin = kLeast * mean;
  if (end * mean < kLeast * square_of_mean && begin * mean > square_of_mean) end = kLeast * mean;
  constexpr double kAngle = 1.0;  // κ [rad]: amplitudes are as small as changes within a tick
  const engine::math::SineCosine half = engine::math::sin_cos(0.5 * kAngle);
  const double sinc = half.sine / (0.5 * kAngle);
  const double p = (0.5 * (begin + end) - mean) / (half.cosine - sinc);
  const double q = 0.5 * (end - begin) / half.sine;
  motor->amplitude = engine::math::hypot(p, q);
  motor->frequency = kAngle / (2.0 * engine::kPi * h);
  motor->phase = engine::math::atan2(p, q) - kAngle * (time / h + 0.5);
  motor->bias = mean - p * sinc;
}

/// The motion from one point of a spline to the next, Σ c_i u^i, at the share u of its duration.
struct Segment {
  double duration;  // [s]
  double u;
  std::array<double, 6> c;

  double value() const {
    return c[0] + u * (c[1] + u * (c[2] + u * (c[3] + u * (c[4] + u * c[5]))));
  }
  double rate() const {
    const double by_u =
        c[1] + u * (2.0 * c[2] + u * (3.0 * c[3] + u * (4.0 * c[4] + u * 5.0 * c[5])));
    return by_u / duration;
  }
};

/// Returns the segment at a time between the first and the last point.
Segment segment_at(double time, const std::vector<TrajectoryPoint>& points, int order) {
  const auto next =
      std::upper_bound(points.begin(), points.end(), time,
                       [](double t, const TrajectoryPoint& point) { return t < point.time; });
  const TrajectoryPoint &a = *(next - 1), &b = *next;
  const double T = b.time - a.time;
  Segment segment{T, (time - a.time) / T, {a.position}};
  auto& c = segment.c;
  const double d = b.position - a.position;
  const double v_a = T * a.velocity, v_b = T * b.velocity;
  const double a_a = T * T * a.acceleration, a_b = T * T * b.acceleration;
  if (order == 1) {
    c[1] = d;
  } else if (order == 3) {
    c[1] = v_a;
    c[2] = 3.0 * d - 2.0 * v_a - v_b;
    c[3] = v_a + v_b - 2.0 * d;
  } else {
    c[1] = v_a;
    c[2] = 0.5 * a_a;
    c[3] = 10.0 * d - 6.0 * v_a - 4.0 * v_b - 1.5 * a_a + 0.5 * a_b;
    c[4] = -15.0 * d + 8.0 * v_a + 7.0 * v_b + 1.5 * a_a - a_b;
    c[5] = 6.0 * d - 3.0 * v_a - 3.0 * v_b - 0.5 * a_a + 0.5 * a_b;
  }
  return segment;
}

}  // namespace

Spline::Spline(std::vector<TrajectoryPoint> points, int order)
    : points_(std::move(points)), order_(order) {}

double Spline::at(double time) const {
  if (time <= points_.front().time) return points_.front().position;
  if (time >= points_.back().time) return points_.back().position;
  return segment_at(time, points_, order_).value();
}

double Spline::rate(double time) const {
  if (time <= points_.front().time || time >= points_.back().time) return 0.0;
  return segment_at(time, points_, order_).rate();
}

void Trajectories::begin(const engine::World& world, const JointTrajectory& trajectory) {
  check(trajectory);
  std::map<std::uint32_t, OnItsWay> next;
  for (std::size_t k = 0; k < trajectory.joints.size(); ++k) {
    const std::string& name = trajectory.joints[k];
    if (!world.has_joint(name)) refuse_joints("there is no constraint named '" + name + "'");
    const engine::JointId id = world.find_joint(name);
    const OnItsWay way{name,
                       {spline_of(world, id, trajectory, k, std::max(0.0, -trajectory.delay)),
                        world.time() + trajectory.delay},
                       is_to_position(world.joint(id), id)};
    if (!next.emplace(id.value, way).second) refuse_joints("'" + name + "' is there twice");
  }
  for (auto& [id, way] : next) on_their_way_.insert_or_assign(id, std::move(way));
}

// A trajectory in progress drives a motor to a position by a rate; its own flag counts then.
bool Trajectories::is_to_position(const engine::Joint& joint, engine::JointId id) const {
  const engine::Motor& motor = *joint.coordinates[0].motor;
  if (motor.position) return !motor.is_servo();
  const auto found = on_their_way_.find(id.value);
  return found != on_their_way_.end() && found->second.joint == joint.name &&
         found->second.to_position;
}

std::optional<TimedSpline> Trajectories::course(engine::JointId joint) const {
  const auto found = on_their_way_.find(joint.value);
  if (found == on_their_way_.end()) return std::nullopt;
  return found->second.course;
}

bool Trajectories::drop(engine::JointId joint) {
  const auto found = on_their_way_.find(joint.value);
  if (found == on_their_way_.end()) return false;
  const bool to_position = found->second.to_position;
  on_their_way_.erase(found);
  return to_position;
}

std::vector<std::string> Trajectories::end() {
  std::vector<std::string> names;
  for (const auto& [id, way] : on_their_way_) names.push_back(way.joint);
  on_their_way_.clear();
  return names;
}

std::vector<std::string> Trajectories::before_step(Driver* driver) {
  std::vector<std::string> failures;
  for (auto next = on_their_way_.begin(); next != on_their_way_.end();) {
    bool goes_on = false;
    try {
      goes_on = advance(engine::JointId{next->first}, next->second, driver);
    } catch (const std::invalid_argument& error) {
      failures.push_back(of_joint(next->second.joint) + "leaves its trajectory: " + error.what());
    }
    next = goes_on ? std::next(next) : on_their_way_.erase(next);
  }
  return failures;
}

// Sets the motor for the next tick; returns false at the end of the trajectory.
bool Trajectories::advance(engine::JointId id, const OnItsWay& way, Driver* driver) {
  const engine::World& world = driver->world();
  // After a change of the world the id may belong to another joint.
  if (!world.has_joint(way.joint) || world.find_joint(way.joint) != id ||
      !world.joint(id).coordinates[0].motor)
    return false;
  const double h = world.options().time_step;
  const double since = world.time() - way.course.start;
  if (since + h <= 0.0) return true;
  const bool is_over = since >= way.course.spline.duration();
  const double target = way.course.spline.at(since + h);
  engine::Motor motor = *world.joint(id).coordinates[0].motor;
  motor.timeout = motor.amplitude = motor.frequency = motor.phase = 0.0;
  if (motor.is_servo()) {
    motor.position = target;
  } else if (is_over && way.to_position) {
    // The motor holds the end for a tick first, since a position sets out from the present rate.
    const bool holds = motor.position || motor.bias == 0.0;
    motor.bias = 0.0;
    if (holds) motor.position = way.course.spline.end();
    driver->set_motor(id, motor);
    return !holds;
  } else {
    motor.position.reset();
    motor.bias = 0.0;
    if (!is_over)
      set_rate(way.course.spline.rate(since + kInside * h),
               (target - world.joint_state(id).coordinates[0].held) / h,
               way.course.spline.rate(since + (1.0 - kInside) * h), world.time(), h, &motor);
  }
  driver->set_motor(id, motor);
  return !is_over;
}

}  // namespace constraint_sim
