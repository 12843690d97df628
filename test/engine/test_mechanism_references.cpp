// References of mechanisms against themselves, published figures and differences, without the
// engine.

#include <gtest/gtest.h>

#include <array>

#include "coupled_mechanisms.h"
#include "flat_mechanisms.h"

namespace constraint_sim::engine::mechanisms {
namespace {

using Make = std::function<Mechanism(int steps)>;

/// Returns all mechanisms with an integrated reference, and their default number of steps.
std::vector<std::pair<Make, int>> integrated() {
  return {{double_hinge_pendulum, 384},
          {spinning_top, 1536},
          {slider_crank, 384},
          {four_bar, 768},
          {universal_shaft, 384},
          {bricard, 64},
          {squeezer, 384},
          {[](int steps) { return planetary_gear(steps).mechanism; }, 384},
          {[](int steps) { return swinging_atwood(1.0, steps).mechanism; }, 128},
          {[](int steps) { return swinging_atwood(2.0, steps).mechanism; }, 128}};
}

/// Returns all mechanisms, including those in closed form.
std::vector<Mechanism> all() {
  std::vector<Mechanism> all;
  for (const auto& [make, steps] : integrated()) all.push_back(make(steps));
  for (const Mechanism& mechanism :
       {driven_slider_crank(), driven_universal_shaft(), falling_nut().mechanism,
        falling_rack().mechanism, parallelograms(3, 2.0)})
    all.push_back(mechanism);
  return all;
}

Real difference(const Poses& a, const Poses& b) {
  Real largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (int k = 0; k < 3; ++k) largest = std::max(largest, std::abs(a[i].x[k].v - b[i].x[k].v));
    for (int k = 0; k < 9; ++k)
      largest = std::max(largest, std::abs(a[i].R(k / 3, k % 3).v - b[i].R(k / 3, k % 3).v));
  }
  return largest;
}

// Bound: rounding in long double amplified by the motion, below double precision.
TEST(MechanismReferences, DoNotChangeWithTheirStep) {
  for (const auto& [make, steps] : integrated()) {
    const Mechanism mechanism = make(steps);
    EXPECT_LE(difference(mechanism.end, make(2 * steps).end), 2e-14L) << mechanism.name;
  }
}

// Bound: rounding of 1e4 steps in long double.
TEST(MechanismReferences, KeepEnergy) {
  for (const auto& [make, steps] : integrated()) {
    const Mechanism mechanism = make(steps);
    if (!mechanism.reference) continue;
    const OneCoordinate& reference = *mechanism.reference;
    const Reals end = minimal::integrate(reference, mechanism.start,
                                         static_cast<Real>(mechanism.duration), steps);
    const OneCoordinate::Energies energies = reference.energies(end[0]);
    const Real scale = energies.m * end[1] * end[1] / 2 + std::abs(energies.V);
    EXPECT_LE(std::abs(reference.energy(end) - reference.energy(mechanism.start)), 2e-15L * scale)
        << mechanism.name;
  }
}

// Fourth-order differences over 1e-3 of functions of size one in long double: 1e-16 and the fifth
// derivative times 1e-12.
TEST(MechanismReferences, DeriveInertiaAndPotentialByTheCoordinate) {
  for (const Mechanism& mechanism : all()) {
    if (!mechanism.reference) continue;
    const Real q = mechanism.start[0] + 0.1L, h = 1e-3L;
    const auto at = [&](int k) { return mechanism.reference->energies(q + k * h); };
    const auto slope = [&](Real OneCoordinate::Energies::*of) {
      return (8 * (at(1).*of - at(-1).*of) - (at(2).*of - at(-2).*of)) / (12 * h);
    };
    const OneCoordinate::Energies energies = at(0);
    const Real tolerance = 1e-9L;
    EXPECT_NEAR(
        static_cast<double>((energies.dm - slope(&OneCoordinate::Energies::m)) / energies.m), 0.0,
        static_cast<double>(tolerance))
        << mechanism.name;
    EXPECT_NEAR(static_cast<double>((energies.dV - slope(&OneCoordinate::Energies::V)) /
                                    (std::abs(energies.V) + energies.m)),
                0.0, static_cast<double>(tolerance))
        << mechanism.name;
  }
}

// Anchors and axes fixed in the bodies' initial poses coincide in the final poses, up to rounding
// of states in double precision.
TEST(MechanismReferences, EndWithAllJointsClosed) {
  for (const Mechanism& mechanism : all()) {
    for (const JointAt& joint : mechanism.joints) {
      const auto end = [&](int body, const Vector3d& at, bool is_point) -> Vector3d {
        if (body == kGround) return at;
        const auto i = static_cast<std::size_t>(body);
        const BodyState& start = mechanism.bodies[i].state;
        const Eigen::Quaterniond turn =
            minimal::orientation(mechanism.end[i]) * start.orientation.conjugate();
        if (!is_point) return turn * at;
        return minimal::position(mechanism.end[i]) + turn * (at - start.position);
      };
      const auto both = [&](const Vector3d& at, bool is_point) -> Vector3d {
        return end(joint.b, at, is_point) - end(joint.a, at, is_point);
      };
      const Vector3d d = both(joint.point, true);
      const Vector3d axis = end(joint.a, joint.axis, false);
      const bool slides = joint.kind == JointKind::kSlider || joint.kind == JointKind::kCylindrical;
      EXPECT_LE((slides ? Vector3d(d - d.dot(axis) * axis) : d).norm(), 2e-15) << mechanism.name;
      if (joint.kind == JointKind::kHinge || slides) {
        EXPECT_LE(both(joint.axis, false).norm(), 2e-15) << mechanism.name;
      }
      if (joint.second_axis) {
        EXPECT_LE(std::abs(axis.dot(end(joint.b, *joint.second_axis, false))), 2e-15);
      }
    }
  }
}

TEST(MechanismReferences, CloseBricardsLoop) {
  for (const Real alpha : {1.3L, 1.5L, 1.7L}) {
    const Pose ground = bricard_poses(Jet(alpha, 1, 0)).back();
    Pose expected;
    expected.x[0] = 0.5L;
    EXPECT_LE(difference({ground}, {expected}), 1e-18L);
    for (int k = 0; k < 3; ++k) EXPECT_LE(std::abs(ground.x[k].dd), 1e-17L);
  }
}

// Pins meet where the published initial values of all seven angles place them, and the crank ends
// where the test set for initial value problems has it, whose tolerance is 1e-9 of the angle.
TEST(MechanismReferences, HaveTheSqueezerAsPublished) {
  const auto unit = [](double angle) { return Vector3d(std::cos(angle), std::sin(angle), 0.0); };
  const double gamma = 0.455279819163070380255912382449;
  const double delta = 0.487364979543842550225598953530;
  const double epsilon = 1.23054744454982119249735015568;
  const Squeezer::Pins pins = Squeezer::pins(Real{Squeezer::kStart});
  const Vector3d A = point_of({Squeezer::xa, Squeezer::ya});
  const Vector3d B = point_of({Squeezer::xb, Squeezer::yb});
  const double right = static_cast<double>(minimal::kPi / 2);
  EXPECT_LE((point_of(pins.P) - B - 0.035 * unit(gamma - right)).norm(), 1e-16);
  EXPECT_LE((point_of(pins.K) - A - 0.04 * unit(delta)).norm(), 1e-16);
  EXPECT_LE((point_of(pins.L) - A - 0.04 * unit(epsilon - right)).norm(), 1e-16);
  const Mechanism made = squeezer();
  const Reals y = minimal::integrate(*made.reference, made.start, 0.03L, 384);
  EXPECT_NEAR(static_cast<double>(y[0]), 15.81077119629904, 2e-9);
}

// Figures of IFToMM's A02; its 20 s with ten turns amplify rounding in long double.
TEST(MechanismReferences, HaveTheParallelogramsAsPublished) {
  const auto top = [](const Mechanism& mechanism) {
    return Vector3d(2.0 * minimal::position(mechanism.end.front()));
  };
  EXPECT_LE((top(parallelograms(2, 10.0)) - Vector3d(0.328458111540815379, 0, 0.944518538178600962))
                .norm(),
            2e-14);
  EXPECT_LE(
      (top(parallelograms(40, 20.0)) - Vector3d(0.410901153762945222, 0, 0.911679900971980652))
          .norm(),
      1e-13);
}

// Sums of coordinates of couplings between hinges, screws and racks in the final poses, up to whole
// turns of each.
TEST(MechanismReferences, EndWithAllCouplingsMet) {
  for (const CoupledMechanism& made : {planetary_gear(), falling_nut(), falling_rack()}) {
    const Mechanism& mechanism = made.mechanism;
    for (const Coupling& coupling : made.couplings) {
      double sum = 0.0, least_ratio = 1.0;
      for (const Coupling::Term& term : coupling.terms) {
        const JointAt& joint = mechanism.joints[term.joint];
        const auto b = static_cast<std::size_t>(joint.b);
        const auto rotation = [&](std::size_t i) -> Eigen::Quaterniond {
          return minimal::orientation(mechanism.end[i]) *
                 mechanism.bodies[i].state.orientation.conjugate();
        };
        if (term.of == CoordinateOf::kTranslation) {
          sum += term.ratio * joint.axis.dot(minimal::position(mechanism.end[b]) -
                                             mechanism.bodies[b].state.position);
          continue;
        }
        Eigen::Quaterniond relative = rotation(b);
        if (joint.a != kGround)
          relative = rotation(static_cast<std::size_t>(joint.a)).conjugate() * relative;
        sum += term.ratio * 2.0 * std::atan2(relative.vec().dot(joint.axis), relative.w());
        least_ratio = std::min(least_ratio, std::abs(term.ratio));
      }
      // half turns of the angle with the least ratio, whose multiples are the others
      const double half_turn = static_cast<double>(minimal::kPi) * least_ratio;
      EXPECT_NEAR(std::remainder(sum, half_turn), 0.0, 1e-13) << mechanism.name;
    }
  }
}

// ω₂ = ω₁ cos β/(1 − sin²β sin²θ).
TEST(MechanismReferences, TurnTheSecondShaftUnevenly) {
  const Real beta = kShaftAngle, theta = 0.8L;
  const Poses poses = universal_shaft_poses(Jet(theta, 1, 0));
  const double rate = minimal::state(poses[1], 1.0).angular_velocity.dot(output_direction());
  const Real sine = std::sin(beta) * std::sin(theta);
  EXPECT_NEAR(rate, static_cast<double>(std::cos(beta) / (1 - sine * sine)), 1e-15);
}

}  // namespace
}  // namespace constraint_sim::engine::mechanisms
