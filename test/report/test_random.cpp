// Random scenes of the report are equal for equal numbers, their judge finds each kind of fault,
// and the program prints equal outcomes twice.

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "engine/math/numbers.h"
#include "report/judge.h"
#include "run_python.h"
#include "temporary_folder.h"
#include "test_paths.h"

namespace constraint_sim::report {
namespace {

using Eigen::Vector3d;

const Problem& scene(int number) { return problem_named("random_" + std::to_string(number)); }

TEST(RandomScenes, CoverAllClassesAndExtremes) {
  std::set<std::string> classes;
  double shortest = 1.0, longest = 1.0, ratio = 1.0, stiffest = 0.0, step = 0.0, spin = 0.0;
  for (int number = 1; number <= 300; ++number) {
    const Problem& made = scene(number);
    classes.insert(made.group);
    EXPECT_GE(made.samples(), 20) << number;
    EXPECT_GE(made.duration, 1.0 - 1e-12) << number;
    shortest = std::min(shortest, made.length);
    longest = std::max(longest, made.length);
    step = std::max(step, made.sample);
    double least = 1e300, most = 0.0;
    for (const Body& body : made.bodies) {
      spin = std::max(spin, body.start.angular_velocity.norm());
      if (body.is_static) continue;
      least = std::min(least, body.mass);
      most = std::max(most, body.mass);
    }
    ratio = std::max(ratio, most / least);
    for (const Joint& joint : made.joints) stiffest = std::max(stiffest, joint.stiffness);
    // the judge's measures are zero at the start: joints fit, and nothing overlaps
    States start;
    for (const Body& body : made.bodies) start.push_back(body.start);
    EXPECT_LT(constraint_error(made, start, 0.0), 1e-9 * made.length) << number;
    if (made.has_shapes()) {
      EXPECT_LT(penetration(made, start), 1e-9 * made.length) << number;
    }
  }
  EXPECT_EQ(classes.size(), 7u);
  EXPECT_LT(shortest, 1e-5);
  EXPECT_GT(longest, 1e5);
  EXPECT_GT(ratio, 1e7);
  EXPECT_GT(stiffest, 1e8);
  EXPECT_GT(step, 0.5);
  EXPECT_GT(spin, 1e4);
}

// ---- the judge

/// A mass that turns about the origin on a rod of 2 m with 1 rad/s, without gravity, for 1 s.
Problem turning_mass() {
  Problem made;
  made.gravity.setZero();
  made.length = 2.0;
  Body mass;
  mass.start.position = {2.0, 0.0, 0.0};
  mass.start.velocity = {0.0, 2.0, 0.0};
  made.bodies = {mass};
  made.joints = {Joint()};
  return made;
}

Motion motion_of_turning_mass(const Problem& problem) {
  Motion motion;
  for (int k = 0; k <= problem.samples(); ++k) {
    const double angle = k * problem.sample;
    State state;
    state.position = 2.0 * Vector3d(std::cos(angle), std::sin(angle), 0.0);
    state.velocity = 2.0 * Vector3d(-std::sin(angle), std::cos(angle), 0.0);
    motion.sample.push_back(k);
    motion.states.push_back({state});
  }
  return motion;
}

TEST(Judge, HoldsTheRightMotion) {
  const Problem problem = turning_mass();
  const Motion motion = motion_of_turning_mass(problem);
  EXPECT_EQ(judge(problem, motion, true, {}, {motion.states, {}}).grade, Grade::kHeld);
}

void expect(const Judgement& found, Grade grade, Criterion criterion, double amount) {
  EXPECT_EQ(found.grade, grade);
  EXPECT_EQ(found.worst, criterion) << name(found.worst);
  EXPECT_NEAR(found.amount, amount, 1e-6 * amount);
  EXPECT_EQ(found.word, Word::kSilent);
}

TEST(Judge, FindsStretchedRodsAndEnergyFromNowhere) {
  const Problem problem = turning_mass();
  const Motion right = motion_of_turning_mass(problem);
  Motion motion = right;
  motion.states[4][0].position *= 1.05;
  expect(judge(problem, motion, true, {}, {}), Grade::kInaccurate, Criterion::kJoint, 0.05);
  motion.states[4][0].position *= 3.0 / 1.05;
  Judgement found = judge(problem, motion, true, {}, {});
  expect(found, Grade::kBlewUp, Criterion::kJoint, 2.0);
  EXPECT_DOUBLE_EQ(found.time, 0.4);

  // the scale is the kinetic energy, 2 J, and that of moving over the length within the run, 2 J
  motion = right;
  motion.states[9][0].velocity *= 3.0;
  expect(judge(problem, motion, true, {}, {}), Grade::kBlewUp, Criterion::kEnergy, 16.0 / 4.0);

  found = judge(problem, right, false, {}, {});
  EXPECT_EQ(found.grade, Grade::kBlewUp);
  EXPECT_EQ(found.worst, Criterion::kFinite);
}

TEST(Judge, FindsOverlapAndLostMomentumAndBrokenLimits) {
  Problem falling;
  falling.bodies.resize(2);
  falling.bodies[0].shape = Shape::kPlane;
  falling.bodies[0].is_static = true;
  falling.bodies[1].shape = Shape::kSphere;
  falling.bodies[1].size.x() = 0.5;
  falling.bodies[1].start.position.z() = 0.5;
  falling.duration = falling.sample;
  Motion motion{{0, 1}, {States(2), States(2)}};
  motion.states[0][1] = motion.states[1][1] = falling.bodies[1].start;
  EXPECT_EQ(judge(falling, motion, true, {}, {}).grade, Grade::kHeld);
  motion.states[1][1].position.z() = 0.45;
  expect(judge(falling, motion, true, {}, {}), Grade::kInaccurate, Criterion::kPenetration, 0.1);
  motion.states[1][1].position.z() = -0.5;
  expect(judge(falling, motion, true, {}, {}), Grade::kBlewUp, Criterion::kPenetration, 2.0);

  Problem hinge;
  hinge.bodies.resize(1);
  hinge.bodies[0].inertia.setOnes();
  hinge.joints.resize(1);
  hinge.joints[0].kind = JointKind::kHinge;
  hinge.joints[0].lower = -0.5;
  hinge.joints[0].upper = 0.5;
  hinge.gravity.setZero();
  motion = {{0, 1}, {States(1), States(1)}};
  motion.states[1][0].orientation = Eigen::AngleAxisd(-0.8, Vector3d::UnitZ());
  expect(judge(hinge, motion, true, {}, {}), Grade::kInaccurate, Criterion::kLimit, 0.3);

  Problem free = turning_mass();
  free.joints.clear();
  free.bodies.push_back(free.bodies[0]);
  motion = {{0, 1}, {States(2), States(2)}};
  for (States& states : motion.states) states = {free.bodies[0].start, free.bodies[1].start};
  EXPECT_EQ(judge(free, motion, true, {}, {}).grade, Grade::kHeld);
  for (State& state : motion.states[1]) state.velocity = {2.0, 0.0, 0.0};  // equal energy
  expect(judge(free, motion, true, {}, {}), Grade::kBlewUp, Criterion::kMomentum, std::sqrt(2.0));
}

TEST(Judge, ComparesWithAReferenceAndHearsTheEngine) {
  const Problem problem = turning_mass();
  const Motion motion = motion_of_turning_mass(problem);
  Reference reference{motion.states, {}};
  reference.exact.resize(5);
  reference.exact[4][0].position += Vector3d(0.0, 0.0, 0.2);
  const double path = (reference.exact[4][0].position - motion.states[0][0].position).norm();
  const double error = 0.2 / std::max(path, 2.0);
  expect(judge(problem, motion, true, {}, reference), Grade::kInaccurate, Criterion::kReference,
         error);

  Said said;
  said.motion = 0.005;  // too small to be a word about an error of 0.2 m
  EXPECT_EQ(judge(problem, motion, true, said, reference).word, Word::kSilent);
  said.motion = 0.05;
  EXPECT_EQ(judge(problem, motion, true, said, reference).word, Word::kSaid);
  said.motion = std::nan("");
  EXPECT_EQ(judge(problem, motion, true, said, reference).word, Word::kSaid);
  said = Said();
  said.warning = "a warning";
  EXPECT_EQ(judge(problem, motion, true, said, reference).said, "a warning");

  // a disturbance that grew a hundredfold explains what an estimate alone does not
  said = Said();
  said.motion = 0.005;
  reference.disturbed = reference.exact;
  reference.disturbed[4][0].position.z() += 100.0 * kDisturbance * std::max(path, problem.length);
  const Judgement found = judge(problem, motion, true, said, reference);
  EXPECT_EQ(found.word, Word::kGrown);
  EXPECT_NEAR(found.growth, 100.0, 1e-4);
}

// ---- the program

std::string page_of(const std::string& options) {
  const engine::TemporaryFolder folder;
  const std::string page = folder.path() + "/page.md";
  EXPECT_EQ(run_python(std::string(CONSTRAINT_SIM_SOURCE_DIR) +
                       "/bench/report/random_grid.py --programs " +
                       std::filesystem::path(CONSTRAINT_SIM_REPORT).parent_path().string() +
                       " --memory 0 --output " + page + " " + options),
            "");
  std::ifstream file(page);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST(RandomGrid, PrintsEqualOutcomesTwice) {
  const std::string options = "--scenes 5 --budget 20 --engines 'constraint_sim auto'";
  const std::string once = page_of(options);
  EXPECT_NE(once.find("| constraint_sim auto | 5 |"), std::string::npos) << once;
  EXPECT_EQ(once, page_of(options));
}

/// Ten sweeps over rods in steps of 0.5 s, where a mass turns by 2 rad in a step.
TEST(RandomGrid, FailsAMethodOutOfItsDepth) {
  const std::string page =
      page_of("--only 3 --no-reference --engines 'constraint_sim sequential_impulses_10'");
  EXPECT_EQ(page.find(" held "), std::string::npos) << page;
}

}  // namespace
}  // namespace constraint_sim::report
