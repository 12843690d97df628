// The report's measures against known answers, its references against published values and
// conserved quantities, and the whole pipeline on a tiny set.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "engine/math/numbers.h"
#include "problems.h"
#include "report/measures.h"
#include "report/tree.h"
#include "run_python.h"
#include "temporary_folder.h"
#include "test_paths.h"

namespace constraint_sim::report {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

using engine::kPi;

// ---- measures

/// A rotating box of 2 kg, and a point mass on a rod of 5 m to the world.
Problem two_bodies() {
  Problem problem;
  problem.duration = 0.1;
  Body box;
  box.mass = 2.0;
  box.inertia = {1.0, 2.0, 3.0};
  Body mass;
  mass.mass = 1.0;
  mass.start.position = {3.0, 0.0, 4.0};
  problem.bodies = {box, mass};
  Joint rod;
  rod.b = 1;
  problem.joints = {rod};
  return problem;
}

States start_of(const Problem& problem) {
  States states;
  for (const Body& body : problem.bodies) states.push_back(body.start);
  return states;
}

TEST(Measures, AngleBetweenOrientations) {
  const Quaterniond none = Quaterniond::Identity();
  for (const double angle : {1e-9, 0.5, 3.0}) {
    const Quaterniond turned(Eigen::AngleAxisd(angle, Vector3d(1.0, 2.0, 3.0).normalized()));
    // rounding of the unit quaternion, 1e-16, without loss at small angles
    EXPECT_NEAR(angle_between(none, turned), angle, 4e-16);
    Quaterniond negative = turned;
    negative.coeffs() *= -1.0;  // equal orientation
    EXPECT_NEAR(angle_between(none, negative), angle, 4e-16);
  }
}

TEST(Measures, EnergyOfKnownStates) {
  Problem problem = two_bodies();
  problem.gravity = {0.0, 0.0, -10.0};
  problem.bodies[0].force = {7.0, 0.0, 0.0};
  States states = start_of(problem);
  states[0].position = {1.0, 0.0, 0.5};
  states[0].orientation = Eigen::AngleAxisd(kPi / 2.0, Vector3d::UnitZ());  // y of the body is −x
  states[0].velocity = {0.0, 3.0, 0.0};
  states[0].angular_velocity = {1.0, 0.0, 0.0};
  // ½·2·9 + ½·2·1² of the box; its weight 2·10·0.5, the force −7·1; the mass 1·10·4
  EXPECT_NEAR(kinetic_energy(problem, states), 10.0, 1e-14);
  EXPECT_NEAR(energy(problem, states), 10.0 + 10.0 - 7.0 + 40.0, 1e-14);

  problem.joints[0].kind = JointKind::kSpring;
  problem.joints[0].stiffness = 100.0;
  states[1].position = {3.0, 0.0, 4.5};  // √29.25 from 5 m
  const double stretch = std::sqrt(29.25) - 5.0;
  EXPECT_NEAR(energy(problem, states), 10.0 + 3.0 + 45.0 + 50.0 * stretch * stretch, 1e-13);
}

TEST(Measures, ErrorsOfJoints) {
  Problem problem = two_bodies();
  States states = start_of(problem);
  EXPECT_EQ(constraint_error(problem, states, 1.0), 0.0);
  states[1].position = {3.0, 0.0, 4.0 + 1e-3};
  const double length = std::hypot(3.0, 4.001);
  EXPECT_NEAR(constraint_error(problem, states, 1.0), length - 5.0, 1e-15);
  problem.joints[0].rate = 0.1;  // the target length has grown
  EXPECT_NEAR(constraint_error(problem, states, 2.0), 5.2 - length, 1e-15);

  Joint ball;
  ball.kind = JointKind::kBall;
  ball.anchor_a = {0.0, 1.0, 0.0};
  ball.anchor_b = {1.0, 0.0, 0.0};
  problem.joints = {ball};
  states[0].orientation = Eigen::AngleAxisd(kPi / 2.0, Vector3d::UnitZ());  // x of the body is y
  EXPECT_NEAR(constraint_error(problem, states, 0.0), 0.0, 1e-15);
  states[0].position.z() = 0.25;
  EXPECT_NEAR(constraint_error(problem, states, 0.0), 0.25, 1e-15);
}

TEST(Measures, Penetration) {
  Problem problem = two_bodies();
  problem.joints.clear();
  Body plane;
  plane.is_static = true;
  plane.shape = Shape::kPlane;
  problem.bodies.push_back(plane);
  problem.bodies[0].shape = Shape::kBox;
  problem.bodies[0].size = {2.0, 2.0, 2.0};
  problem.bodies[1].shape = Shape::kSphere;
  problem.bodies[1].size.x() = 0.5;
  States states = start_of(problem);
  states[0].position.z() = 1.5;
  EXPECT_EQ(penetration(problem, states), 0.0);
  states[0].orientation = Eigen::AngleAxisd(kPi / 4.0, Vector3d::UnitY());  // on an edge
  states[0].position.z() = 1.4;
  EXPECT_NEAR(penetration(problem, states), std::sqrt(2.0) - 1.4, 1e-15);
  states[1].position.z() = 0.4;  // deeper
  EXPECT_NEAR(penetration(problem, states), 0.1, 1e-15);
}

TEST(Measures, PenetrationOfSpheres) {
  // unsorted along x: 0.5 m apart on x, 0.25 m on y, far, and a large one that reaches the far one
  Problem problem;
  States states;
  const auto add = [&](const Vector3d& position, double radius) {
    Body sphere;
    sphere.shape = Shape::kSphere;
    sphere.size.x() = radius;
    problem.bodies.push_back(sphere);
    State state;
    state.position = position;
    states.push_back(state);
  };
  add({10.0, 0.0, 0.0}, 0.25);
  add({0.0, 0.0, 0.0}, 0.25);
  add({0.5, 0.0, 0.0}, 0.25);
  EXPECT_EQ(penetration(problem, states), 0.0);  // spheres touch
  add({0.5, 0.25, 0.0}, 0.25);
  EXPECT_NEAR(penetration(problem, states), 0.25, 1e-15);
  add({13.0, 0.0, 0.0}, 3.25);
  EXPECT_NEAR(penetration(problem, states), 0.5, 1e-15);
  states[1].position.y() = std::nan("");
  EXPECT_TRUE(std::isnan(penetration(problem, states)));
}

TEST(Measures, WorstOfAllSamplesAndBodies) {
  Problem problem = two_bodies();
  problem.duration = 0.2;
  const States start = start_of(problem);
  const Trajectory reference(3, start);
  Motion motion{{0, 1, 2}, reference};
  motion.states[1][0].position.x() += 0.1;
  motion.states[2][1].position.y() -= 0.3;
  motion.states[1][0].orientation = Eigen::AngleAxisd(0.2, Vector3d::UnitX());
  motion.states[2][1].orientation =
      Eigen::AngleAxisd(0.5, Vector3d::UnitX());  // points have no orientation
  const Errors worst = errors(problem, motion, reference);
  EXPECT_NEAR(worst.position, 0.3, 1e-15);
  EXPECT_NEAR(worst.orientation, 0.2, 1e-15);
  EXPECT_NEAR(worst.constraint, std::sqrt(25.09) - 5.0, 1e-14);
  EXPECT_TRUE(std::isnan(worst.momentum));     // at rest there is no scale
  EXPECT_TRUE(std::isnan(worst.penetration));  // no shapes

  problem.measured = {0};
  EXPECT_NEAR(errors(problem, motion, reference).position, 0.1, 1e-15);
  const Errors unknown = errors(problem, motion, {});
  EXPECT_TRUE(std::isnan(unknown.position));
  EXPECT_NEAR(unknown.constraint, std::sqrt(25.09) - 5.0, 1e-14);
}

TEST(Measures, MomentumAndEnergyAreRelative) {
  Problem problem = two_bodies();
  problem.joints.clear();
  problem.gravity.setZero();
  problem.bodies[0].start.velocity = {5.0, 0.0, 0.0};
  const States start = start_of(problem);
  Motion motion{{0, 1}, Trajectory(2, start)};
  motion.states[1][0].velocity.x() = 5.5;
  const Errors worst = errors(problem, motion, Trajectory(2, start));
  EXPECT_NEAR(worst.momentum, 0.1, 1e-15);  // 11 of 10 kg m/s
  EXPECT_NEAR(worst.energy, 0.21, 1e-15);   // 30.25 of 25 J
  motion.states[1][0].velocity = {5.0, 0.0, 0.0};
  motion.states[1][0].position.y() = 1.0;  // angular momentum about the origin, zero before
  EXPECT_NEAR(errors(problem, motion, Trajectory(2, start)).momentum, 0.0, 1e-15);
}

TEST(Measures, WhatIsNotFiniteIsNeverDropped) {
  Problem problem = two_bodies();
  const States start = start_of(problem);
  Motion motion{{0, 1}, Trajectory(2, start)};
  motion.states[1][0].position.x() = std::nan("");
  EXPECT_FALSE(is_finite(motion.states[1]));
  EXPECT_TRUE(std::isnan(errors(problem, motion, Trajectory(2, start)).position));
}

// ---- references

Vector3d last(const std::string& name, std::size_t body) {
  return problem_named(name).reference(1).back()[body].position;
}

TEST(References, ArriveWherePublished) {
  // IFToMM A01, mirrored; given to 18 digits
  EXPECT_LE(
      (last("pendulum", 0) - Vector3d(0.27508746257611686, 0.0, -0.961419205099125064)).norm(),
      1e-13);
  // OSRF's boxes, given to 16 digits; near the unstable axis rounding of the inertia grows ten
  // thousand times
  const State box = problem_named("free_box_complex").reference(1).back().front();
  EXPECT_LE(angle_between(box.orientation, engine::problems::free_box_orientation()), 2e-11);
  // IFToMM A02, given to 18 digits: the top of the first upright bar is twice its centre
  EXPECT_LE(
      (2.0 * last("n_four_bar_2", 0) - Vector3d(0.328458111540815379, 0.0, 0.944518538178600962))
          .norm(),
      1e-12);
  EXPECT_LE(
      (2.0 * last("n_four_bar_40", 0) - Vector3d(0.410901153762945222, 0.0, 0.911679900971980652))
          .norm(),
      1e-10);
}

TEST(References, OfChainsAgreeWithLagrangesEquations) {
  for (const int links : {2, 10}) {
    const Problem& problem =
        problem_named(links == 2 ? "double_pendulum" : "chain_" + std::to_string(links));
    const States end = problem.reference(1).back();
    const auto expected = engine::problems::chain_reference(links, problem.duration, 1.0 / 64.0);
    // both are integrated to 1e-13 m, and positions reach 10 m
    for (std::size_t i = 0; i < end.size(); ++i)
      EXPECT_LE((end[i].position - expected[i]).norm(), 1e-12) << links << " " << i;
  }
}

/// Returns the problems whose reference takes less than a second.
std::vector<const Problem*> cheap_problems() {
  std::vector<const Problem*> cheap;
  for (const Problem& problem : problems()) {
    const bool is_stiff = problem.group == "stiff" ||
                          problem.name.rfind("chain_load_1e+0", 0) == 0 ||
                          problem.name.rfind("spin_", 0) == 0 || problem.name.find("_spin_") < 20;
    if (problem.reference && !is_stiff && problem.bodies.size() <= 100 &&
        problem.name.rfind("hung_inertia", 0) != 0)
      cheap.push_back(&problem);
  }
  return cheap;
}

TEST(References, BeginAtTheStartAndKeepJointsAndEnergy) {
  const auto cheap = cheap_problems();
  EXPECT_GE(cheap.size(), 60u);
  for (const Problem* problem : cheap) {
    const Trajectory trajectory = problem->reference(1);
    ASSERT_EQ(trajectory.size(), static_cast<std::size_t>(problem->samples()) + 1) << problem->name;
    Motion motion{{}, trajectory};
    for (int k = 0; k <= problem->samples(); ++k) motion.sample.push_back(k);
    const bool is_whole = problem->measured.empty();  // else only some bodies are known
    if (!is_whole) continue;
    const Errors errors = report::errors(*problem, motion, trajectory);
    double largest = problem->length;
    for (const States& states : trajectory)
      for (const State& state : states) largest = std::max(largest, state.position.norm());
    for (std::size_t i = 0; i < problem->bodies.size(); ++i)
      EXPECT_LE((trajectory.front()[i].position - problem->bodies[i].start.position).norm(),
                1e-15 * largest)
          << problem->name;
    // rounding of positions and orientations to double, of two bodies per joint
    if (!problem->has_conflict && !std::isnan(errors.constraint)) {
      EXPECT_LE(errors.constraint, 1e-15 * largest) << problem->name;
    }
    // error of the references times the forces over the scale of energy; springs of 1e12 N/m make
    // 1e-5 of the rounding of lengths
    if (!std::isnan(errors.energy) && problem->group != "stiff rows") {
      EXPECT_LE(errors.energy, 1e-10) << problem->name;
    }
  }
}

/// The integral of the velocities is the displacement, by Simpson's rule over samples. The
/// tolerance is coarse, but shows a wrong sign, factor or frame.
TEST(References, VelocitiesBelongToPositions) {
  for (const char* name : {"pendulum", "conical_pendulum", "dumbbell", "ring_12", "oscillator",
                           "compound_pendulum", "n_four_bar_2", "sliding_ball", "bouncing"}) {
    Problem problem = problem_named(name);
    const Trajectory trajectory = problem.reference(1);
    for (std::size_t i = 0; i < problem.bodies.size(); ++i) {
      Vector3d moved = Vector3d::Zero();
      double fastest = 0.0;
      for (std::size_t k = 0; k < 8; k += 2) {
        moved += 0.1 / 3.0 *
                 (trajectory[k][i].velocity + 4.0 * trajectory[k + 1][i].velocity +
                  trajectory[k + 2][i].velocity);
        fastest = std::max(fastest, trajectory[k + 1][i].velocity.norm());
      }
      EXPECT_LE((trajectory[8][i].position - trajectory[0][i].position - moved).norm(),
                0.02 * fastest + 1e-12)
          << name << " " << i;
    }
  }
}

// ---- the table of problems

TEST(Problems, AreManyAndHaveNamesOfTheirOwn) {
  std::map<std::string, int> names;
  int graded = 0, extreme = 0;
  for (const Problem& problem : problems()) {
    ++names[problem.name];
    ++(problem.is_graded ? graded : extreme);
    EXPECT_EQ(problem.source.empty(), !problem.reference) << problem.name;
    EXPECT_GT(problem.samples(), 0) << problem.name;
  }
  for (const auto& [name, count] : names) EXPECT_EQ(count, 1) << name;
  EXPECT_GE(graded, 25);
  EXPECT_GE(extreme, 60);
}

// ---- joint coordinates

TEST(Problems, OfEverySizeAreMadeByName) {
  EXPECT_EQ(problem_named("links_30").joints.size(), 30u);
  EXPECT_EQ(problem_named("bodies_7").bodies.size(), 7u);
  EXPECT_EQ(problem_named("contacts_12").bodies.size(), 13u);  // plus the plane
  EXPECT_GT(problem_named("links_100000").samples(), problem_named("links_100000").warm_up);
  for (const Problem& problem : problems()) EXPECT_EQ(problem.warm_up, 0) << problem.name;
  EXPECT_THROW(problem_named("links_"), std::invalid_argument);
  EXPECT_THROW(problem_named("nothing_10"), std::invalid_argument);
  // balls touch the plane only
  const Problem& contacts = problem_named("contacts_700");
  EXPECT_EQ(penetration(contacts, start_of(contacts)), 0.0);
}

TEST(Tree, HandsOutWhatClosesLoops) {
  std::vector<Joint> loops;
  const Problem& bars = problem_named("n_four_bar_2");  // five bars, seven joints
  EXPECT_EQ(tree_of(bars, &loops).size(), 5u);
  EXPECT_EQ(loops.size(), 2u);
  EXPECT_THROW(tree_of(bars), Unsupported);
}

TEST(Tree, OfAChainAndOfWhatIsNone) {
  const Problem& chain = problem_named("chain_10");
  const std::vector<Link> tree = tree_of(chain);
  ASSERT_EQ(tree.size(), 10u);
  for (std::size_t i = 0; i < tree.size(); ++i) {
    EXPECT_EQ(tree[i].body, static_cast<int>(i));
    EXPECT_EQ(tree[i].parent, static_cast<int>(i) - 1);  // the world is -1
    EXPECT_NEAR((tree[i].centre - Vector3d::UnitX()).norm(), 0.0, 1e-15);
  }
  EXPECT_THROW(tree_of(problem_named("four_bar_1")), Unsupported);
  EXPECT_THROW(tree_of(problem_named("oscillator")), Unsupported);
  EXPECT_THROW(tree_of(problem_named("ring_12")), Unsupported);
}

TEST(Tree, SpinsOfPointMassesFollowFromVelocities) {
  const Problem& chain = problem_named("heavy_chain_1e3");
  const std::vector<Link> tree = tree_of(chain);
  EXPECT_NEAR(start_spin(chain, tree[0]).norm(), 0.0, 1e-15);
  // the load, 1 m below, moves at 1 m/s along x: ω × (0, 0, −1) = x, so ω = −y
  EXPECT_NEAR((start_spin(chain, tree[10]) + Vector3d::UnitY()).norm(), 0.0, 1e-14);
}

// ---- the pipeline

TEST(Pipeline, FiguresAgreeWithAnswersByHand) {
  EXPECT_EQ(run_python(std::string(CONSTRAINT_SIM_SOURCE_DIR) + "/test/report/test_figures.py"),
            "");
}

TEST(Pipeline, CommittedSummaryComesFromTheStudies) {
  EXPECT_EQ(run_python(std::string(CONSTRAINT_SIM_SOURCE_DIR) + "/test/report/test_committed.py '" +
                       CONSTRAINT_SIM_REPORT + "'"),
            "");
}

std::string content(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> parts;
  std::stringstream stream(line);
  for (std::string part; std::getline(stream, part, ',');) parts.push_back(part);
  return parts;
}

/// Independent references against the engine, with a tolerance of 1e-10 m/s over a few seconds: an
/// error of either, or of the adapter's scenes, would show.
TEST(Pipeline, ProblemsOfEventsAreMetByEvents) {
  const engine::TemporaryFolder temporary;
  const std::filesystem::path folder = temporary.path();
  int met = 0;
  for (const Problem& problem : problems()) {
    if (problem.group != "event") continue;
    const std::string program = std::string("'") + CONSTRAINT_SIM_REPORT + "' ";
    const std::string table = (folder / "table.csv").string();
    ASSERT_EQ(std::system((program + "references " + folder.string() + " --problem " +
                           problem.name + " >/dev/null")
                              .c_str()),
              0);
    ASSERT_EQ(std::system((program + "run " + folder.string() + " --problem " + problem.name +
                           " --variant event_driven --values 1e-10 --repeats 1 >" + table)
                              .c_str()),
              0);
    std::ifstream file(table);
    std::string line;
    std::getline(file, line);  // announces the value
    ASSERT_TRUE(std::getline(file, line)) << problem.name;
    const std::vector<std::string> row = split(line);
    ASSERT_EQ(row[4], "ok") << line;
    EXPECT_LT(std::stod(row[8]), 1e-9) << line;
    if (row[9] != "nan") {
      EXPECT_LT(std::stod(row[9]), 1e-9) << line;
    }
    ++met;
  }
  EXPECT_GE(met, 30);
}

/// Two problems, every method of the engine within a budget that sanitizers keep, once unchanged
/// and once with gravity wrong by 1e-3.
TEST(Pipeline, WritesAllPagesAndShowsAPerturbedMethodAsWorse) {
  const engine::TemporaryFolder temporary;
  const std::filesystem::path folder = temporary.path();
  ASSERT_EQ(
      run_python(std::string(CONSTRAINT_SIM_SOURCE_DIR) + "/bench/report/report.py --tiny " +
                 "--rounds 2 --budget 5 --perturb 1e-3 --memory 0 --programs " +
                 std::filesystem::path(CONSTRAINT_SIM_REPORT).parent_path().string() + " --work " +
                 (folder / "work").string() + " --output " + (folder / "out").string()),
      "");
  for (const char* file :
       {"index.html", "grid.html", "summary.md", "columns.md", "raw_columns.md", "cells.csv",
        "grid.csv", "references.csv", "diagrams/pendulum.svg", "diagrams/oscillator.svg",
        "scenes.svg", "stability.svg", "sizes.svg", "data/fronts.csv.xz"})
    EXPECT_GT(std::filesystem::file_size(folder / "out" / file), 100u) << file;

  // every column is described
  std::ifstream cells(folder / "out" / "cells.csv");
  std::string line;
  std::getline(cells, line);
  const std::vector<std::string> header = split(line);
  EXPECT_EQ(header.size(), 16u);
  const std::string columns = content(folder / "out" / "raw_columns.md");
  std::map<std::string, std::size_t> place;
  for (std::size_t i = 0; i < header.size(); ++i) {
    place[header[i]] = i;
    EXPECT_NE(columns.find("| `" + header[i] + "` |"), std::string::npos) << header[i];
  }

  // including those of sizes and of many bodies, where memory and time are
  std::ifstream sizes(folder / "out" / "scaling.csv");
  std::getline(sizes, line);
  const std::vector<std::string> sized = split(line);
  for (const std::string& name : sized)
    EXPECT_NE(columns.find("| `" + name + "` |"), std::string::npos) << name;
  int lines = 0;
  while (std::getline(sizes, line)) {
    const std::vector<std::string> row = split(line);
    ASSERT_EQ(row.size(), sized.size()) << line;
    EXPECT_EQ(row[3], "ok") << line;
    EXPECT_GT(std::stod(row[4]), 0.0) << line;
    ++lines;
  }
  EXPECT_EQ(lines, 12);  // three kinds, two sizes, two methods
  std::ifstream many(folder / "out" / "many.csv");
  std::getline(many, line);
  EXPECT_EQ(split(line), header);
  EXPECT_TRUE(std::getline(many, line) && line.find("pendula_1000") != std::string::npos);

  // all methods are present, twice; gravity wrong by 1e-3 moves the pendulum by about 1e-2 m in 10
  // s
  std::map<std::string, double> best;
  while (std::getline(cells, line)) {
    const std::vector<std::string> row = split(line);
    if (row[place["round"]] == "2") continue;  // without errors
    ASSERT_EQ(row.size(), header.size()) << line;
    if (row[place["problem"]] != "pendulum" || row[place["outcome"]] != "ok") continue;
    double& least = best.try_emplace(row[place["contestant"]], 1e300).first->second;
    least = std::min(least, std::stod(row[place["position"]]));
  }
  for (const char* method : {"auto", "runge_kutta_order_8", "runge_kutta_order_5"}) {
    const std::string name = std::string("constraint_sim ") + method;
    ASSERT_EQ(best.count(name), 1u);
    ASSERT_EQ(best.count(name + " perturbed"), 1u);
    EXPECT_LT(best[name], 1e-6) << name;
    EXPECT_GT(best[name + " perturbed"], 1e-3) << name;
  }
  // the page shows it: to 1e-4 one has a run time and the other none
  const std::string page = content(folder / "out" / "index.html");
  const auto row_of = [&](const std::string& contestant) {
    const std::string start = "<td>pendulum</td><td>" + contestant + "</td>";
    const std::size_t at = page.find(start);
    return at == std::string::npos ? "" : page.substr(at + start.size(), 60);
  };
  const std::string none = "<td>–</td><td>–</td><td>–</td>";
  EXPECT_NE(row_of("constraint_sim auto"), "");
  EXPECT_EQ(row_of("constraint_sim auto").find(none), std::string::npos);
  EXPECT_NE(row_of("constraint_sim auto perturbed").find(none), std::string::npos);
}

}  // namespace
}  // namespace constraint_sim::report
