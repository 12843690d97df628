// Random stiff and extreme scenes, for the stability grid that no engine is tuned to. A scene
// depends on its number alone. random_grid.py --help has the distribution in words.

#include <algorithm>

#include "common.h"
#include "draw.h"
#include "rotation_between.h"

namespace constraint_sim::report {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Range of a scale [low, high], drawn with equal density of its logarithm.
struct Range {
  double low, high;
};
/// A scale is drawn from its whole range in half of the scenes, and from an ordinary range in the
/// others, so that extremes come alone and together.
struct Scale {
  Range ordinary, whole;
};
constexpr Scale kLength{{0.1, 10.0}, {1e-6, 1e6}};  // [m]
constexpr Scale kMassRatio{{1.0, 10.0}, {1.0, 1e9}};
constexpr Scale kStiffness{{1.0, 1e4}, {1.0, 1e9}};  // [N/m]
constexpr Scale kStep{{1e-3, 2e-2}, {1e-3, 1.0}};    // [s]
constexpr Scale kSpin{{0.1, 10.0}, {0.1, 1e5}};      // [rad/s]
constexpr Range kMass{1e-3, 1e3};                    // lightest mass of a scene [kg]
constexpr double kPointGyration = 1e-3;              // Problem::point_gyration over the length
constexpr double kFewestSteps = 20.0, kLeastDuration = 1.0;  // [1], [s]

/// Motion of a point, to which a body can be attached.
struct End {
  int body = kWorld;
  Vector3d local = Vector3d::Zero();  ///< in the frame of the body or world [m]
  Vector3d position = Vector3d::Zero(), velocity = Vector3d::Zero();
};

class RandomScene {
 public:
  explicit RandomScene(int number) : draw_(static_cast<unsigned>(number)) {}

  Problem make() {
    using Add = void (RandomScene::*)();
    static constexpr std::pair<const char*, Add> kClasses[] = {
        {"free bodies", &RandomScene::add_free_bodies},
        {"chain", &RandomScene::add_chain},
        {"springs", &RandomScene::add_springs},
        {"closed loop", &RandomScene::add_loop},
        {"limits", &RandomScene::add_limits},
        {"contacts", &RandomScene::add_contacts},
        {"mixed", &RandomScene::add_mixture}};
    const auto& [name, add] = kClasses[draw_.below(static_cast<int>(std::size(kClasses)))];
    length_ = drawn(kLength);
    ratio_ = drawn(kMassRatio);
    stiffness_ = drawn(kStiffness);
    const double step = drawn(kStep);
    spin_ = drawn(kSpin);
    mass_ = decades(kMass);
    problem_ =
        problem("", name, std::max(kFewestSteps, std::ceil(kLeastDuration / step)) * step, length_);
    problem_.is_graded = false;
    problem_.is_planar = false;
    problem_.point_gyration = kPointGyration * length_;
    problem_.sample = step;
    if (chance(0.2)) problem_.gravity.setZero();
    (this->*add)();
    problem_.is_conservative =
        !problem_.has_shapes() && std::none_of(problem_.joints.begin(), problem_.joints.end(),
                                               [](const Joint& joint) { return joint.has_law(); });
    return problem_;
  }

 private:
  bool chance(double share) { return draw_.share() < share; }
  double decades(const Range& range) {
    return std::pow(10.0, draw_.between(std::log10(range.low), std::log10(range.high)));
  }
  double drawn(const Scale& scale) { return decades(chance(0.5) ? scale.ordinary : scale.whole); }
  double mass() { return mass_ * decades({1.0, ratio_}); }
  Vector3d direction() {
    Vector3d v;
    do v = draw_.vector();
    while (v.norm() < 0.1);
    return v.normalized();
  }
  double span() { return length_ * draw_.between(0.5, 1.0); }
  Vector3d spin() { return spin_ * draw_.share() * direction(); }
  /// Returns a velocity up to that of a fall over the length [m/s].
  Vector3d velocity() { return std::sqrt(kGravity * length_) * draw_.share() * direction(); }

  int add(const Body& body) {
    problem_.bodies.push_back(body);
    return static_cast<int>(problem_.bodies.size()) - 1;
  }
  Body& body(int i) { return problem_.bodies[static_cast<std::size_t>(i)]; }
  Body bar(double span) {
    return box(mass(), {span, length_ * decades({0.05, 1.0}), length_ * decades({0.05, 1.0})});
  }

  End world_end() {
    const Vector3d position = length_ * draw_.vector();
    return {kWorld, position, position, Vector3d::Zero()};
  }

  // ---- chains

  /// Hangs a point mass on a rod or spring; returns it.
  End hang_point(const End& from, bool is_spring) {
    const Vector3d arm = span() * direction(), position = from.position + arm;
    const Vector3d velocity = from.velocity + spin().cross(arm);
    Joint joint = rod(from.body, add(point_mass(position, mass(), velocity)), from.local);
    if (is_spring) make_spring(&joint, arm.norm());
    problem_.joints.push_back(joint);
    return {joint.b, Vector3d::Zero(), position, velocity};
  }

  /// Hangs a bar on a ball joint, or by its end on a spring; returns the other end of the bar.
  End hang_bar(const End& from, bool is_spring) {
    const double gap = is_spring ? span() : 0.0, span = this->span();
    const Vector3d near = from.position + gap * direction(), half(0.5 * span, 0.0, 0.0);
    Body made = bar(span);
    made.shape = Shape::kPoint;
    made.start.orientation = draw_.turn();
    made.start.angular_velocity = spin();
    const Vector3d arm = made.start.orientation * half;
    const Vector3d swing = made.start.angular_velocity.cross(arm);
    made.start.position = near + arm;
    made.start.velocity = from.velocity + swing;
    Joint joint = ball_joint(from.body, add(made), from.local, -half);
    if (is_spring) make_spring(&joint, gap);
    problem_.joints.push_back(joint);
    return {joint.b, half, near + 2.0 * arm, from.velocity + 2.0 * swing};
  }

  void make_spring(Joint* joint, double start_length) {
    joint->kind = JointKind::kSpring;
    joint->stiffness = stiffness_;
    joint->length = start_length * draw_.between(0.9, 1.1);
  }

  /// Hangs bodies one on the other; springs have this share. Returns the last end.
  End hang(End end, int count, bool is_of_points, double share_of_springs) {
    for (int i = 0; i < count; ++i) {
      const bool is_spring = chance(share_of_springs);
      end = is_of_points ? hang_point(end, is_spring) : hang_bar(end, is_spring);
    }
    return end;
  }

  /// Returns an end of a new free body, or of the world.
  End root(bool is_of_points) {
    if (chance(0.7)) return world_end();
    if (is_of_points) {
      const Vector3d v = velocity();
      return {add(point_mass(Vector3d::Zero(), mass(), v)), Vector3d::Zero(), Vector3d::Zero(), v};
    }
    return free_bar();
  }

  End free_bar() {
    const double span = this->span();
    Body made = bar(span);
    made.shape = Shape::kPoint;
    made.start.position = length_ * draw_.vector();
    made.start.orientation = draw_.turn();
    made.start.velocity = velocity();
    made.start.angular_velocity = spin();
    const Vector3d half(0.5 * span, 0.0, 0.0), arm = made.start.orientation * half;
    return {add(made), half, made.start.position + arm,
            made.start.velocity + made.start.angular_velocity.cross(arm)};
  }

  // ---- classes

  void add_free_bodies() {
    const int count = 1 + draw_.below(3);
    for (int i = 0; i < count; ++i) free_bar();
  }

  void add_chain() {
    const bool is_of_points = chance(0.5);
    const End from = root(is_of_points);
    hang(from, 1 + draw_.below(10), is_of_points, 0.0);
  }

  void add_springs() {
    const bool is_of_points = chance(0.5);
    const End from = root(is_of_points);
    hang(is_of_points ? hang_point(from, true) : hang_bar(from, true), draw_.below(6), is_of_points,
         0.5);
  }

  /// A polygon between two points of the world, or a free ring. It moves as a rigid body at first:
  /// about the line through the two points, or freely.
  void add_loop() {
    const bool is_free = chance(0.3), is_of_points = chance(0.5);
    const int corners = 3 + draw_.below(6);
    std::vector<Vector3d> corner{length_ * draw_.vector()};
    for (int i = 1; i < corners; ++i) corner.push_back(corner.back() + span() * direction());
    const Vector3d axis =
        is_free ? direction() : Vector3d((corner.back() - corner.front()).normalized());
    const Vector3d spin = spin_ * draw_.share() * axis;
    const Vector3d drift = is_free ? velocity() : Vector3d(Vector3d::Zero());
    const auto velocity_at = [&](const Vector3d& x) {
      return Vector3d(drift + spin.cross(x - corner.front()));
    };
    if (is_of_points) {
      std::vector<int> at;
      for (int i = 0; i < corners; ++i) {
        const Vector3d& x = corner[static_cast<std::size_t>(i)];
        const bool is_fixed = !is_free && (i == 0 || i == corners - 1);
        at.push_back(is_fixed ? kWorld : add(point_mass(x, mass(), velocity_at(x))));
      }
      const auto join = [&](int i, int k) {
        const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(k);
        if (at[a] == kWorld && at[b] == kWorld) return;
        const bool is_turned = at[b] == kWorld;  // B is a body
        const std::size_t first = is_turned ? b : a, second = is_turned ? a : b;
        problem_.joints.push_back(
            rod(at[first], at[second], at[first] == kWorld ? corner[first] : Vector3d::Zero()));
      };
      for (int i = 1; i < corners; ++i) join(i - 1, i);
      if (is_free) join(corners - 1, 0);
      for (int i = 2; i < corners; ++i)
        if (chance(0.3)) join(i - 2, i);
      return;
    }
    End from{kWorld, corner.front(), corner.front(), Vector3d::Zero()};
    const int bars = is_free ? corners : corners - 1;
    End first;
    for (int i = 0; i < bars; ++i) {
      const Vector3d& x = corner[static_cast<std::size_t>(i)];
      const Vector3d& y = corner[static_cast<std::size_t>((i + 1) % corners)];
      Body made = bar((y - x).norm());
      made.shape = Shape::kPoint;
      made.start.position = 0.5 * (x + y);
      made.start.orientation = rotation_between(Vector3d::UnitX(), (y - x).normalized());
      made.start.velocity = velocity_at(made.start.position);
      made.start.angular_velocity = spin;
      const Vector3d half(0.5 * (y - x).norm(), 0.0, 0.0);
      const int number = add(made);
      if (i == 0) first = {number, -half, x, Vector3d::Zero()};
      if (i > 0 || !is_free)
        problem_.joints.push_back(ball_joint(from.body, number, from.local, -half));
      from = {number, half, y, Vector3d::Zero()};
    }
    const Vector3d last = from.local;
    problem_.joints.push_back(is_free ? ball_joint(first.body, from.body, first.local, last)
                                      : ball_joint(kWorld, from.body, corner.back(), last));
  }

  void add_limits() {
    const double restitution = chance(0.5) ? 0.0 : draw_.share();
    if (chance(0.5)) {
      hang(add_rope(restitution), draw_.below(4), true, 0.2);
      return;
    }
    const End end = chance(0.5) ? add_on_hinge(restitution) : add_on_slider(restitution);
    hang(end, draw_.below(4), false, 0.2);
  }

  /// Adds a point mass on a rope that is slack at first.
  End add_rope(double restitution) {
    const End from = world_end();
    const Vector3d arm = span() * direction(), position = from.position + arm, v = velocity();
    Joint rope = rod(kWorld, add(point_mass(position, mass(), v)), from.local);
    rope.kind = JointKind::kFreeLength;
    rope.upper = arm.norm() * draw_.between(1.0, 1.3);
    rope.restitution = restitution;
    problem_.joints.push_back(rope);
    return {rope.b, Vector3d::Zero(), position, v};
  }

  /// Returns a joint with axes between the world and a new bar, with limits at a share of `range`.
  Joint limited(JointKind kind, double range, double restitution) {
    const double span = this->span();
    Body made = bar(span);
    made.shape = Shape::kPoint;
    made.start.orientation = draw_.turn();
    const Vector3d half(0.5 * span, 0.0, 0.0);
    const Vector3d at = length_ * draw_.vector();
    made.start.position = at + made.start.orientation * half;
    Joint joint = ball_joint(kWorld, add(made), at, -half);
    joint.kind = kind;
    joint.frame_a = draw_.turn();
    joint.frame_b = made.start.orientation.conjugate() * joint.frame_a;
    joint.lower = -range * draw_.share();
    joint.upper = range * draw_.share();
    joint.restitution = restitution;
    return joint;
  }

  End end_of(const Joint& joint) {
    const State& start = body(joint.b).start;
    const Vector3d half = -joint.anchor_b, arm = start.orientation * half;
    return {joint.b, half, start.position + arm,
            start.velocity + start.angular_velocity.cross(arm)};
  }

  End add_on_hinge(double restitution) {
    constexpr double kWidest = 2.5;  // [rad]; below a half turn, from where an angle is ambiguous
    Joint joint = limited(JointKind::kHinge, kWidest, restitution);
    State& start = body(joint.b).start;
    start.angular_velocity = spin_ * draw_() * (joint.frame_a * Vector3d::UnitZ());
    start.velocity = start.angular_velocity.cross(start.orientation * -joint.anchor_b);
    problem_.joints.push_back(joint);
    return end_of(joint);
  }

  End add_on_slider(double restitution) {
    Joint joint = limited(JointKind::kSlider, length_, restitution);
    if (chance(0.3)) joint.friction = draw_.share() * body(joint.b).mass * kGravity;
    body(joint.b).start.velocity =
        std::sqrt(kGravity * length_) * draw_() * (joint.frame_a * Vector3d::UnitZ());
    problem_.joints.push_back(joint);
    return end_of(joint);
  }

  /// Balls one above the other on a plane, the lowest a box in half of the scenes, at rest or
  /// thrown.
  void add_contacts() {
    problem_.gravity = {0.0, 0.0, -kGravity};
    const double friction = chance(0.5) ? 0.0 : draw_.share();
    const double restitution = chance(0.5) ? 0.0 : draw_.share();
    const bool has_box = chance(0.5), is_thrown = chance(0.5);
    add(plane(friction, restitution));
    const int count = 1 + draw_.below(6);
    double height = 0.0;
    for (int i = 0; i < count; ++i) {
      const double gap = is_thrown ? 2.0 * length_ * draw_.share() : 0.0;
      const double x = 0.2 * length_ * draw_(), y = 0.2 * length_ * draw_();
      double reach = 0.0;  // half of the height
      Body made;
      if (i == 0 && has_box) {
        made = bar(span());
        made.shape = Shape::kBox;
        made.friction = friction;
        made.restitution = restitution;
        if (is_thrown) made.start.orientation = draw_.turn();
        reach = 0.5 * (is_thrown ? made.size.norm() : made.size.z());
      } else {
        reach = length_ * draw_.between(0.15, 0.5);
        made = ball(mass(), reach, Vector3d::Zero(), friction, restitution);
      }
      made.start.position = {x, y, height + gap + reach};
      height += gap + 2.0 * reach;
      if (is_thrown) {
        made.start.velocity = velocity();
        made.start.angular_velocity = spin();
      }
      add(made);
    }
  }

  /// A chain of masses on rods and springs with a ball at its end over a plane, in half of the
  /// scenes closed by a rod to the world, and a ball that falls beside it.
  void add_mixture() {
    problem_.gravity = {0.0, 0.0, -kGravity};
    const double friction = chance(0.5) ? 0.0 : draw_.share();
    const double radius = length_ * draw_.between(0.15, 0.5);
    End end = chance(0.3) ? add_rope(0.0) : world_end();
    end = hang(end, 1 + draw_.below(4), true, 0.3);
    const Vector3d arm = span() * direction();
    Body load = ball(mass(), radius, end.position + arm, friction);
    load.start.velocity = end.velocity;
    problem_.joints.push_back(rod(end.body, add(load), end.local));
    const int last = problem_.joints.back().b;
    if (chance(0.5)) {
      for (Body& body : problem_.bodies) body.start.velocity.setZero();
      problem_.joints.push_back(rod(kWorld, last, length_ * draw_.vector()));
    }
    Body ground = plane(friction, 0.0);
    ground.start.position.z() =
        load.start.position.z() - radius - length_ * (chance(0.5) ? 0.0 : draw_.share());
    add(ground);
    const double reach = length_ * draw_.between(0.15, 0.5);
    Body beside = ball(mass(), reach, load.start.position, friction);
    beside.start.position += Vector3d(radius + reach + 0.1 * length_, 0.0, 0.0);
    beside.start.position.z() =
        std::max(beside.start.position.z(), ground.start.position.z() + reach);
    beside.start.velocity = velocity();
    beside.start.angular_velocity = spin();
    add(beside);
    for (Body& body : problem_.bodies) body.friction = friction;  // some peers have one for all
  }

  engine::Draw draw_;
  Problem problem_;
  double length_ = 1.0, ratio_ = 1.0, stiffness_ = 1.0, spin_ = 1.0, mass_ = 1.0;
};

const Registration kRandom("random", [](int number) { return RandomScene(number).make(); });

}  // namespace
}  // namespace constraint_sim::report
