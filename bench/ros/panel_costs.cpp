// Costs of the panel of rviz with thousands of rows, in rviz's own thread [ms], as median of 21:
// filling the tree, drawing it with new states in all rows, and finding motors in the text from
// save_scene. Needs no display.
//
//   constraint_sim_panel_costs [BODIES ...]    1000 3000 10000 by default

#include <QApplication>
#include <QTreeView>
#include <algorithm>
#include <boost/make_shared.hpp>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "panel/motors.h"
#include "panel/world_model.h"

namespace constraint_sim::panel {
namespace {

constexpr int kRounds = 21;
constexpr std::size_t kMostMotors = 50;

template <class Work>
double milliseconds(Work work) {
  std::vector<double> all;
  for (int round = 0; round < kRounds; ++round) {
    const auto start = std::chrono::steady_clock::now();
    work(round);
    all.push_back(1e3 *
                  std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  std::nth_element(all.begin(), all.begin() + kRounds / 2, all.end());
  return all[kRounds / 2];
}

BodyStatesConstPtr bodies_of(std::size_t count, double x) {
  const auto message = boost::make_shared<BodyStates>();
  message->bodies.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    message->bodies[i].name = "plank_" + std::to_string(i);
    message->bodies[i].pose.position.x = x + static_cast<double>(i);
  }
  return message;
}

ConstraintStatesConstPtr constraints_of(std::size_t count, double force) {
  const auto message = boost::make_shared<ConstraintStates>();
  message->constraints.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    message->constraints[i].name = "joint_" + std::to_string(i);
    message->constraints[i].type = "ball";
    message->constraints[i].force = force;
  }
  return message;
}

std::string bridge_of(std::size_t count) {
  std::string text = "world: {time_step: 0.01}\nbodies:\n";
  for (std::size_t i = 0; i < count; ++i)
    text += "  - name: plank_" + std::to_string(i) +
            "\n    type: dynamic\n    shape: {box: {size: [0.5, 1, 0.1]}}\n    mass: 1\n"
            "    position: [" +
            std::to_string(i) + ", 0, 0]\n";
  text += "constraints:\n";
  for (std::size_t i = 0; i < 2 * count; ++i)
    text += "  - name: joint_" + std::to_string(i) + "\n    type: ball\n    body_b: plank_" +
            std::to_string(i / 2) + "\n    anchor_a: [0, 0, 0]\n    anchor_b: [0, 0, 0]\n";
  return text;
}

void measure(std::size_t count) {
  WorldModel model;
  QTreeView tree;
  tree.setModel(&model);
  tree.setUniformRowHeights(true);
  tree.expandAll();
  tree.resize(380, 250);
  tree.show();
  const auto set = [&](const BodyStatesConstPtr& bodies, const ConstraintStatesConstPtr& joints) {
    model.set_bodies(bodies);
    model.set_constraints(joints);
    QApplication::processEvents();
    tree.viewport()->repaint();
  };
  // two alternating messages, owned elsewhere
  const BodyStatesConstPtr bodies[] = {bodies_of(count, 0.0), bodies_of(count, 0.5)};
  const ConstraintStatesConstPtr joints[] = {constraints_of(2 * count, 1.0),
                                             constraints_of(2 * count, 2.0)};
  const double filled = milliseconds([&](int) {
    set(nullptr, nullptr);
    set(bodies[0], joints[0]);
  });
  const double updated =
      milliseconds([&](int round) { set(bodies[round % 2], joints[round % 2]); });
  const std::string text = bridge_of(count);
  const double motors = milliseconds([&](int) { motors_in(text, kMostMotors); });
  std::printf("| %zu | %zu | %.2f | %.2f | %.1f |\n", count, 2 * count, filled, updated, motors);
  std::fflush(stdout);
}

}  // namespace
}  // namespace constraint_sim::panel

int main(int argc, char** argv) {
  setenv("QT_QPA_PLATFORM", "offscreen", 1);
  const QApplication application(argc, argv);
  std::puts(
      "| bodies | constraints | emptied and filled [ms] | all rows new, drawn [ms] | motors [ms] "
      "|\n"
      "| ---: | ---: | ---: | ---: | ---: |");
  std::vector<std::string> counts(argv + 1, argv + argc);
  if (counts.empty()) counts = {"1000", "3000", "10000"};
  for (const std::string& count : counts) constraint_sim::panel::measure(std::stoul(count));
  return 0;
}
