// Mechanisms by runge_kutta, against minimal coordinates.

#include "coupled_mechanisms.h"
#include "flat_mechanisms.h"
#include "support.h"

namespace constraint_sim::engine::mechanisms {
namespace {

const std::vector<Mechanism>& table() {
  static const std::vector<Mechanism> kMechanisms{double_hinge_pendulum(),
                                                  spinning_top(),
                                                  slider_crank(),
                                                  four_bar(),
                                                  universal_shaft(),
                                                  bricard(),
                                                  squeezer(),
                                                  driven_slider_crank(),
                                                  driven_universal_shaft(),
                                                  with_couplings(planetary_gear()),
                                                  with_couplings(falling_nut()),
                                                  with_couplings(falling_rack()),
                                                  with_couplings(swinging_atwood(1.0)),
                                                  with_couplings(swinging_atwood(2.0))};
  return kMechanisms;
}

class EachMechanism : public testing::TestWithParam<std::size_t> {
 protected:
  const Mechanism& mechanism() const { return table()[GetParam()]; }
};

std::string test_name(const testing::TestParamInfo<std::size_t>& info) {
  std::string name;
  for (const char c : table()[info.param].name)
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) name += c;
  return name;
}

// Returns the bound of joint errors: four roundings of positions up to 2 m, or of gear angles of
// some turns.
double closed(const Mechanism& mechanism) {
  return (mechanism.name.find("pinion") == std::string::npos &&
                  mechanism.name.find("planetary") == std::string::npos
              ? 8.0
              : 4.0 * 50.0) *
         kEpsilon;
}

// One step a tick: three times the error of dense equations, since rows are eliminated in another
// order; below 1e-12 rounding and the motion's own sensitivity count.
TEST_P(EachMechanism, ConvergesAsDenseEquationsDo) {
  std::vector<double> errors;
  for (std::size_t i = 0; i < mechanism().steps.size(); ++i) {
    const Outcome outcome = run(mechanism(), mechanism().steps[i], 0.0);
    EXPECT_FALSE(outcome.has_failed);
    EXPECT_EQ(outcome.dependent_rows, mechanism().dependent_rows);
    EXPECT_LE(outcome.joints, closed(mechanism()));
    EXPECT_LE(outcome.error, std::max(3.0 * mechanism().expected_errors[i], 1e-12))
        << mechanism().steps[i];
    if (outcome.error >= 1e-12) errors.push_back(outcome.error);
  }
  if (errors.size() >= 2) {  // the last halving above rounding; coarse steps have other orders
    EXPECT_GE(std::log2(errors[errors.size() - 2] / errors.back()), 7.5);
  }
}

TEST_P(EachMechanism, MeetsItsTolerance) {
  const double tick = mechanism().is_judged_by_angles ? 1.0 / 1000.0 : 1.0 / 30.0;
  const Outcome outcome = run(mechanism(), tick, 1e-9);
  EXPECT_FALSE(outcome.has_failed);
  EXPECT_LE(outcome.joints, closed(mechanism()));
  EXPECT_LE(outcome.error, 1e-8);
}

INSTANTIATE_TEST_SUITE_P(Mechanisms, EachMechanism, testing::Range<std::size_t>(0, 14), test_name);

// 40 parallelograms that are in line twice a turn, 20 times in 20 s; 120 rows are redundant, and 40
// more where all bars are in line. The benchmark requires 1e-4 m.
TEST(Parallelograms, PassTheirSingularPoses) {
  for (const auto& [windows, duration] : {std::pair{1, 10.0}, {2, 10.0}, {40, 20.0}}) {
    const Mechanism made = parallelograms(windows, duration / kSanitizedShare);
    const Outcome outcome = run(made, 1.0 / 30.0, 1e-8);
    EXPECT_FALSE(outcome.has_failed) << windows;
    EXPECT_EQ(outcome.dependent_rows, made.dependent_rows);
    // Corrections leave rounding along a chain of 41 bars, of coordinates of 40 m.
    EXPECT_LE(outcome.joints, 4.0 * kEpsilon * (windows + 1));
    EXPECT_LE(outcome.error, 1e-6) << windows;
  }
}

}  // namespace
}  // namespace constraint_sim::engine::mechanisms
