// Event-driven contacts of bodies whose centre of mass is off the centre of their shape. Oracles:
// closed forms, and equations of one angle in long double.

#include "by_events.h"
#include "problems.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using problems::Reals;

constexpr double kBallMass = 2.0, kBallInertia = 0.03, kBallRadius = 0.2;

class PosedContactsAt : public testing::TestWithParam<Carried> {};

INSTANTIATE_TEST_SUITE_P(Ticks, PosedContactsAt,
                         testing::ValuesIn(each_setting(Method::kEventDriven)));

/// A ball with its shape's centre at `offset` from its centre of mass, with isotropic inertia.
Body lopsided_ball(const Vector3d& offset) {
  Body ball = make_body("ball", Sphere{kBallRadius}, kBallMass, Vector3d::Zero());
  ball.inertia = Vector3d::Constant(kBallInertia);
  ball.shape_pose = ShapePose{offset, Quaterniond(0.7, 0.1, -0.5, 0.5)};
  return ball;
}

/// A lopsided ball without friction above z = 0: between impacts its centre of mass falls, and its
/// rotation is constant; an impulse p n at r from the centre changes v by p/m and ω by p r × n/I.
struct Bouncing {
  Vector3d offset;
  double e;
  BodyState state;
  std::vector<Event> hits;  ///< time and impulse

  BodyState after(double t) const {
    BodyState later = state;
    later.position += t * state.linear_velocity - 0.5 * kGravity * t * t * Vector3d::UnitZ();
    later.linear_velocity.z() -= kGravity * t;
    const double speed = state.angular_velocity.norm();
    if (speed > 0.0)
      later.orientation = AngleAxisd(speed * t, state.angular_velocity / speed) * state.orientation;
    return later;
  }
  static double gap(const BodyState& now, const Vector3d& offset) {
    return now.position.z() + (now.orientation * offset).z() - kBallRadius;
  }
  void advance(double since, double h) {
    constexpr int kLooks = 1000;
    double done = 0.0;
    for (int k = 0; k < kLooks && done < h;) {
      const double next = k + 1 == kLooks ? h : h * (k + 1) / kLooks;
      if (gap(after(next - done), offset) >= 0.0) {
        ++k;
        if (k == kLooks) state = after(h - done), done = h;
        continue;
      }
      double low = 0.0, high = next - done;
      for (int i = 0; i < 80; ++i) {
        const double middle = 0.5 * (low + high);
        (gap(after(middle), offset) >= 0.0 ? low : high) = middle;
      }
      state = after(low);
      done += low;
      const Vector3d n = Vector3d::UnitZ(), r = state.orientation * offset - kBallRadius * n;
      const double rate = n.dot(state.linear_velocity + state.angular_velocity.cross(r));
      const double p =
          -(1.0 + e) * rate / (1.0 / kBallMass + r.cross(n).squaredNorm() / kBallInertia);
      state.linear_velocity += p / kBallMass * n;
      state.angular_velocity += p / kBallInertia * r.cross(n);
      Event& hit = hits.emplace_back();
      hit.time = since + done;
      hit.impulse = p;
    }
  }
};

TEST_P(PosedContactsAt, ALopsidedBallBounces) {
  for (const double e : {0.7, 1.0}) {
    World world(by_events(GetParam()));
    world.add_body(with_surface(make_floor(0.0), 0.0, e));
    Bouncing expected{{0.03, -0.05, 0.02}, e, {}, {}};
    Body ball = with_surface(lopsided_ball(expected.offset), 0.0, e);
    ball.state.position.z() = 0.6;
    ball.state.linear_velocity = {0.5, 0.0, 0.3};
    ball.state.angular_velocity = {2.0, -1.0, 3.0};
    expected.state = ball.state;
    const BodyId id = world.add_body(ball);
    std::vector<Event> events;
    while (world.time() < 1.2 - 1e-9) {
      expected.advance(world.time(), GetParam());
      const std::vector<Event> now = advance(&world, GetParam());
      for (const Event& event : now)
        if (event.impulse > 0.0) events.push_back(event);
      // growth of an error of the tolerance from impact to impact
      ASSERT_LT((world.state(id).position - expected.state.position).norm(), 1e-8) << world.time();
      ASSERT_LT(world.state(id).orientation.angularDistance(expected.state.orientation), 1e-7);
    }
    ASSERT_EQ(events.size(), expected.hits.size());
    EXPECT_GE(events.size(), 2u);
    for (std::size_t i = 0; i < events.size(); ++i) {
      EXPECT_NEAR(events[i].time, expected.hits[i].time, 1e-9);
      EXPECT_NEAR(events[i].impulse, expected.hits[i].impulse, 1e-7);
    }
    if (e == 1.0) {
      const double start =
          kBallMass * kGravity * 0.6 + 0.5 * kBallMass * 0.34 + 0.5 * kBallInertia * 14.0;
      EXPECT_NEAR(world.energy(), start, 1e-8);
    }
  }
}

// A ball with its mass d below the centre rocks by an angle θ; without friction its centre of mass
// moves vertically, with friction the ball rolls.
//   (I + m d² sin²θ) θ̈ = −m d² sin θ cos θ θ̇² − m g d sin θ
//   (I + m (r² + d² − 2 r d cos θ)) θ̈ = −m r d sin θ θ̇² − m g d sin θ
TEST_P(PosedContactsAt, ALopsidedBallRocks) {
  constexpr double d = 0.05, kStart = 1.0;
  for (const bool rolls : {false, true}) {
    World world(by_events(GetParam()));
    world.add_body(make_floor(rolls ? 2.0 : 0.0));
    Body ball = with_surface(lopsided_ball({0.0, 0.0, d}), rolls ? 2.0 : 0.0, 0.0);
    ball.state.orientation = Quaterniond(AngleAxisd(kStart, Vector3d::UnitY()));
    const Vector3d middle(0.0, 0.0, kBallRadius);
    ball.state.position = middle - ball.state.orientation * Vector3d(0.0, 0.0, d);
    const BodyId id = world.add_body(ball);
    const auto rate = [&](const Reals& y) {
      const long double s = std::sin(y[0]), c = std::cos(y[0]), pull = kBallMass * kGravity * d * s;
      return rolls ? Reals{y[1], -(kBallMass * kBallRadius * d * s * y[1] * y[1] + pull) /
                                     (kBallInertia + kBallMass * (kBallRadius * kBallRadius +
                                                                  d * d - 2 * kBallRadius * d * c))}
                   : Reals{y[1], -(kBallMass * d * d * s * c * y[1] * y[1] + pull) /
                                     (kBallInertia + kBallMass * d * d * s * s)};
    };
    Reals turned{static_cast<long double>(kStart), 0};
    for (double t = 0.0; world.time() < 1.5 - 1e-9; t = world.time()) {
      EXPECT_TRUE(advance(&world, GetParam()).empty());
      turned = problems::integrate(rate, turned, static_cast<long double>(world.time()) - t, 1);
      const auto angle = static_cast<double>(turned[0]);
      const double x =
          rolls ? kBallRadius * (angle - kStart) - d * std::sin(angle) : -d * std::sin(kStart);
      const Vector3d place(x, 0.0, kBallRadius - d * std::cos(angle));
      ASSERT_LT((world.state(id).position - place).norm(), 1e-8) << world.time();
      ASSERT_NEAR(2.0 * std::asin(world.state(id).orientation.y()), angle, 1e-7);
    }
  }
}

/// A box with its centre of mass `above` the centre of its shape.
Body topheavy_box(const Vector3d& half, double above) {
  Body box = make_body("box", Box{2.0 * half}, kBallMass, {0.0, 0.0, half.z() + above});
  box.inertia = {0.2, 0.15, 0.1};
  box.shape_pose = ShapePose{{0.0, 0.0, -above}, Quaterniond::Identity()};
  return box;
}

// A box pushed at its centre of mass, h above the ground, tips where F h > m g w about the edge
// that holds: (I + m ρ²) θ̈ = F ρ sin φ − m g ρ cos φ, φ the angle of its centre of mass.
TEST_P(PosedContactsAt, ABoxTipsByTheHeightOfItsMass) {
  const Vector3d half(0.2, 0.15, 0.4);
  for (const double above : {0.2, -0.25}) {
    const double high = half.z() + above, ratio = half.x() / high;
    for (const double off : {-1e-4, 1e-4, 0.3}) {
      World world(by_events(GetParam()));
      world.add_body(with_surface(make_floor(0.0), 2.0, 0.0));
      const BodyId id = world.add_body(with_surface(topheavy_box(half, above), 2.0, 0.0));
      const double push = (1.0 + off) * ratio;
      Wrench wrench;
      wrench.body = id;
      wrench.force.x() = push * kBallMass * kGravity;
      world.add_wrench(wrench);
      const double arm = std::hypot(half.x(), high), start = std::atan2(high, half.x());
      const auto rate = [&](const Reals& y) {
        const long double phi = start + y[0];
        return Reals{y[1], kBallMass * kGravity * arm * (push * std::sin(phi) - std::cos(phi)) /
                               (0.15 + kBallMass * arm * arm)};
      };
      Reals turned{0, 0};
      for (double t = 0.0; world.time() < 0.4 - 1e-9; t = world.time()) {
        advance(&world, GetParam());
        if (off > 0.0)
          turned = problems::integrate(rate, turned, static_cast<long double>(world.time()) - t, 1);
        const double phi = start + static_cast<double>(turned[0]);
        const Vector3d place(half.x() - arm * std::cos(phi), 0.0, arm * std::sin(phi));
        ASSERT_LT((world.state(id).position - place).norm(), 1e-8) << above << ' ' << off;
      }
      EXPECT_EQ(world.state(id).angular_velocity.y() > 1e-6, off > 0.0) << above << ' ' << off;
    }
  }
}

// While the box slides to rest, friction shifts its load forwards by μ times the height of its
// centre of mass.
TEST_P(PosedContactsAt, ABoxSlidesToRestOnItsCorners) {
  constexpr double kMu = 0.3, kSpeed = 2.0;
  const Vector3d half(0.2, 0.15, 0.4);
  World world(by_events(GetParam()));
  world.add_body(with_surface(make_floor(0.0), kMu, 0.0));
  Body box = with_surface(topheavy_box(half, 0.2), kMu, 0.0);
  box.state.linear_velocity.x() = kSpeed;
  const BodyId id = world.add_body(box);
  std::vector<Event> events;
  bool is_first = true;
  while (world.time() < 1.0 - 1e-9) {
    const std::vector<Event> now = advance(&world, GetParam());
    events.insert(events.end(), now.begin(), now.end());
    if (!is_first) continue;
    is_first = false;
    double force = 0.0, moment = 0.0;
    for (const Contact& contact : world.contacts()) {
      const double x = contact.position.x() - world.state(id).position.x();
      force += contact.normal_force;
      moment += contact.normal_force * (x > 0.0 ? half.x() : -half.x());
    }
    EXPECT_NEAR(force, kBallMass * kGravity, 1e-9);
    EXPECT_NEAR(moment, kMu * kBallMass * kGravity * 0.6, 1e-9);
  }
  const double displacement = kSpeed * kSpeed / (2.0 * kMu * kGravity);
  EXPECT_LT((world.state(id).position - Vector3d(displacement, 0.0, 0.6)).norm(), kPlace);
  EXPECT_LT(world.state(id).angular_velocity.norm(), kPlace);
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].kind, EventKind::kSticks);
  EXPECT_NEAR(events[0].time, kSpeed / (kMu * kGravity), kTime);
}

}  // namespace
}  // namespace constraint_sim::engine
