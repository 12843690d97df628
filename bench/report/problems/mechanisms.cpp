// A problem for each kind of joint with axes, and each kind of coupling: two boxes in a chain on
// the world, or both on the world, released at rest in general poses, so that nothing is planar and
// no axis is principal. Then mechanisms of hinges: a chain, an arm, a quadruped and a loop.

#include "common.h"
#include "rotation_between.h"

namespace constraint_sim::report {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

Quaterniond turned(double angle, const Vector3d& axis) {
  return Quaterniond(Eigen::AngleAxisd(angle, axis.normalized()));
}

/// Returns a frame whose z is normal to z of `frame`, for body B of universal joints.
Quaterniond across(const Quaterniond& frame) {
  return frame * turned(kPi / 2.0, Vector3d::UnitX());
}

/// Joins body `b` to `a` at a point in the world; `frame` is the frame on A in the world.
Joint on_axes(const Problem& made, JointKind kind, int a, int b, const Vector3d& point,
              const Quaterniond& frame) {
  const auto state = [&](int i) {
    return i == kWorld ? State{} : made.bodies[static_cast<std::size_t>(i)].start;
  };
  const auto local = [&](int i) -> Vector3d {
    return state(i).orientation.conjugate() * (point - state(i).position);
  };
  Joint joint;
  joint.kind = kind;
  joint.a = a;
  joint.b = b;
  joint.anchor_a = local(a);
  joint.anchor_b = local(b);
  joint.frame_a = state(a).orientation.conjugate() * frame;
  joint.frame_b =
      state(b).orientation.conjugate() * (kind == JointKind::kUniversal ? across(frame) : frame);
  return joint;
}

Problem boxes_alone(const std::string& name, double duration) {
  Problem made = problem(name + "_pair", "mechanism", duration);
  made.is_planar = false;
  made.bodies = {box(2.0, {0.3, 0.5, 0.9}), box(1.0, {0.8, 0.2, 0.4})};
  made.bodies[0].start.position = {0.5, 0.2, -0.3};
  made.bodies[0].start.orientation = turned(0.7, {1.0, -2.0, 0.5});
  made.bodies[1].start.position = {1.2, -0.1, -0.5};
  made.bodies[1].start.orientation = turned(-1.1, {0.3, 1.0, 0.8});
  return made;
}

Problem with_reference(Problem made) {
  made.reference = mechanism_motion(made);
  made.source = "dense reference in long double, by extrapolation";
  return made;
}

Problem on_each_other(const std::string& called, JointKind first, JointKind second,
                      const Vector3d& axis, double duration) {
  Problem made = boxes_alone(called, duration);
  const Quaterniond frame = rotation_between(Vector3d::UnitZ(), axis);
  made.joints = {
      on_axes(made, first, kWorld, 0, Vector3d::Zero(), frame),
      on_axes(made, second, 0, 1, {0.9, 0.1, -0.3}, frame * turned(0.8, {0.6, 0.8, 0.3}))};
  return made;
}

Problem two_boxes(JointKind first, JointKind second, const Vector3d& axis, double duration) {
  return with_reference(on_each_other(name(second), first, second, axis, duration));
}

/// Two hinges, the second on the first box, geared so that one turns by 1/1.7 of the other.
Problem gears(const Vector3d& axis) {
  Problem made = on_each_other("gear", JointKind::kHinge, JointKind::kHinge, axis, 5.0);
  made.couplings = {{0, 1, 1.7}};
  return with_reference(made);
}

/// An unbalanced pinion of 0.2 m, and its rack on a rail.
Problem rack(const Vector3d& axle, const Vector3d& rail) {
  Problem made = boxes_alone("rack", 5.0);
  const auto along = [](const Vector3d& axis) { return rotation_between(Vector3d::UnitZ(), axis); };
  made.joints = {
      on_axes(made, JointKind::kHinge, kWorld, 0, Vector3d::Zero(), along(axle)),
      on_axes(made, JointKind::kSlider, kWorld, 1, made.bodies[1].start.position, along(rail))};
  made.couplings = {{0, 1, -1.0 / 0.2}};
  return with_reference(made);
}

/// A nut on a fixed screw, and a second nut on the screw of the first, with 0.5 m a turn.
Problem screws(const Vector3d& axis) {
  Problem made =
      on_each_other("screw", JointKind::kCylindrical, JointKind::kCylindrical, axis, 1.0);
  const double ratio = -0.5 / (2.0 * kPi);
  made.couplings = {{0, 0, ratio}, {1, 1, ratio}};
  return with_reference(made);
}

/// Two boxes on one rope over two pulleys, off their centres, the first on two strands.
Problem pulley() {
  Problem made = boxes_alone("pulley", 1.0);
  const Vector3d anchors[] = {{-0.6, 0.1, 1.0}, {0.8, -0.2, 1.2}};
  for (int i = 0; i < 2; ++i) {
    Joint rope;
    rope.kind = JointKind::kFreeLength;
    rope.b = i;
    rope.anchor_a = anchors[i];
    rope.anchor_b = {0.1, 0.05, 0.2};
    made.joints.push_back(rope);
  }
  made.couplings = {{0, 1, 0.5}};
  return with_reference(made);
}

/// Bars along x, each hinged to the one before it; axes by number of the hinge.
Problem bars_on_hinges(const std::string& name, const std::vector<double>& lengths,
                       const std::vector<Vector3d>& axes, double duration) {
  Problem made = problem(name, "mechanism", duration);
  made.is_planar = false;
  double reach = 0.0;
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    Body bar = box(2.0 * lengths[i], {lengths[i], 0.06, 0.05});
    bar.start.position = {reach + 0.5 * lengths[i], 0.0, 0.0};
    made.bodies.push_back(bar);
    const int own = static_cast<int>(i);
    made.joints.push_back(on_axes(made, JointKind::kHinge, i == 0 ? kWorld : own - 1, own,
                                  {reach, 0.0, 0.0},
                                  rotation_between(Vector3d::UnitZ(), axes[i % axes.size()])));
    reach += lengths[i];
  }
  return with_reference(made);
}

/// A trunk in flight with four legs of three hinges, about x, y and y. Forces on the lowest links
/// move them.
Problem quadruped() {
  Problem made = problem("quadruped", "mechanism", 1.0);
  made.is_planar = false;
  made.bodies = {box(10.0, {0.6, 0.3, 0.15})};
  const double lengths[] = {0.1, 0.3, 0.3};
  for (int leg = 0; leg < 4; ++leg) {
    const Vector3d hip(leg < 2 ? 0.3 : -0.3, leg % 2 == 0 ? 0.15 : -0.15, 0.0);
    double top = 0.0;
    for (int k = 0; k < 3; ++k) {
      Body link = box(0.5, {0.05, 0.04, lengths[k]});
      link.start.position = hip + Vector3d(0.0, 0.0, top - 0.5 * lengths[k]);
      if (k == 2) link.force = Vector3d(1.0 + leg, 0.5 - leg, 0.3 * leg);
      made.bodies.push_back(link);
      const int own = 1 + 3 * leg + k;
      made.joints.push_back(
          on_axes(made, JointKind::kHinge, k == 0 ? 0 : own - 1, own, hip + Vector3d(0.0, 0.0, top),
                  rotation_between(Vector3d::UnitZ(),
                                   k == 0 ? Vector3d::UnitX() : Vector3d(Vector3d::UnitY()))));
      top -= lengths[k];
    }
  }
  return with_reference(made);
}

/// A crank, a coupler and a rocker on four hinges with parallel axes. Three rows are redundant; in
/// the reference a point on the line of the axis stands for the last hinge.
Problem four_bar() {
  Problem made = problem("hinge_four_bar", "mechanism", 5.0);
  made.is_planar = false;
  const Vector3d axis = Vector3d(0.2, 1.0, 0.1).normalized();
  const Quaterniond frame = rotation_between(Vector3d::UnitZ(), axis);
  const Vector3d points[] = {Vector3d::Zero(), frame * Vector3d(0.3, 0.1, 0.0),
                             frame * Vector3d(0.7, 1.0, 0.1), frame * Vector3d(0.1, 1.2, 0.0)};
  for (int i = 0; i < 3; ++i) {
    const Vector3d between = points[i + 1] - points[i];
    Body bar = box(1.0 + i, {between.norm(), 0.06, 0.05});
    bar.start.position = 0.5 * (points[i] + points[i + 1]);
    bar.start.orientation = rotation_between(Vector3d::UnitX(), between.normalized());
    made.bodies.push_back(bar);
  }
  const auto hinge = [&](int i) {
    return on_axes(made, JointKind::kHinge, i == 0 ? kWorld : i - 1, i < 3 ? i : kWorld, points[i],
                   frame);
  };
  for (int i = 0; i < 3; ++i) made.joints.push_back(hinge(i));
  Joint last = hinge(3);
  std::swap(last.a, last.b);
  std::swap(last.anchor_a, last.anchor_b);
  std::swap(last.frame_a, last.frame_b);
  Problem reduced = made;
  reduced.joints.push_back(last);
  reduced.joints.back().kind = JointKind::kPointOnLine;
  made.joints.push_back(last);
  made.reference = mechanism_motion(reduced);
  made.source = with_reference(reduced).source;
  return made;
}

std::vector<Problem> make() {
  const std::vector<Vector3d> crossed{Vector3d::UnitY(), Vector3d::UnitZ()};
  const Vector3d level(0.3, 1.0, 0.2), steep(0.5, -0.4, 1.0);
  return {gears(level),
          rack(level, steep),
          screws(steep),
          pulley(),
          bars_on_hinges("hinge_chain_10", std::vector<double>(10, 0.4), crossed, 2.0),
          bars_on_hinges("arm_7", {0.2, 0.3, 0.3, 0.2, 0.2, 0.1, 0.1}, crossed, 2.0),
          quadruped(),
          four_bar(),
          two_boxes(JointKind::kHinge, JointKind::kHinge, level, 5.0),
          two_boxes(JointKind::kSlider, JointKind::kSlider, steep, 1.0),
          two_boxes(JointKind::kCylindrical, JointKind::kCylindrical, steep, 1.0),
          two_boxes(JointKind::kPlanar, JointKind::kPlanar, steep, 1.0),
          two_boxes(JointKind::kUniversal, JointKind::kUniversal, level, 5.0),
          two_boxes(JointKind::kHinge, JointKind::kWeld, level, 5.0),
          two_boxes(JointKind::kPointOnLine, JointKind::kPointOnLine, steep, 1.0),
          two_boxes(JointKind::kPointOnPlane, JointKind::kPointOnPlane, steep, 1.0)};
}

const Registration kRegistration(make);

}  // namespace
}  // namespace constraint_sim::report
