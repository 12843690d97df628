// A snapshot answers like its world, at any moment and after any edit, and taking it changes
// nothing.

#include "constraint_sim/engine/plan.h"
#include "constraint_sim/engine/scene.h"
#include "shipped_scenes.h"
#include "support.h"

namespace constraint_sim::engine {
namespace {

std::vector<std::string> texts_of(const std::vector<StepWarning>& warnings) {
  std::vector<std::string> texts;
  for (const StepWarning& warning : warnings) texts.push_back(with_advice(warning));
  return texts;
}

void expect_same_answers(const World& snapshot, const World& world) {
  // all that is saved: bodies, joints, their states, contacts, wrenches, memory, sleep, time
  ASSERT_EQ(save_scene(snapshot), save_scene(world));
  ASSERT_EQ(explain(snapshot), explain(world));
  EXPECT_EQ(snapshot.energy(), world.energy());
  EXPECT_EQ(snapshot.unresolved_bodies(), world.unresolved_bodies());
  EXPECT_EQ(snapshot.unclosed_joints(), world.unclosed_joints());
  EXPECT_EQ(texts_of(snapshot.warnings()), texts_of(world.warnings()));
  EXPECT_EQ(snapshot.report().step, world.report().step);
  EXPECT_EQ(snapshot.report().energy.total, world.report().energy.total);
  ASSERT_EQ(snapshot.body_ids(), world.body_ids());
  for (const BodyId id : world.body_ids()) {
    EXPECT_EQ(snapshot.state(id).position, world.state(id).position);
    EXPECT_EQ(snapshot.state(id).linear_velocity, world.state(id).linear_velocity);
  }
  for (const JointId id : world.joint_ids()) {
    EXPECT_EQ(snapshot.joint_state(id).force, world.joint_state(id).force);
    EXPECT_EQ(snapshot.joint_state(id).error, world.joint_state(id).error);
  }
  ASSERT_EQ(snapshot.contacts().size(), world.contacts().size());
  for (std::size_t i = 0; i < world.contacts().size(); ++i)
    EXPECT_EQ(snapshot.contacts()[i].normal_force, world.contacts()[i].normal_force);
  const std::vector<Island> seen = snapshot.islands(), islands = world.islands();
  ASSERT_EQ(seen.size(), islands.size());
  for (std::size_t i = 0; i < islands.size(); ++i) {
    EXPECT_EQ(seen[i].why, islands[i].why);
    EXPECT_EQ(seen[i].method, islands[i].method);
    EXPECT_EQ(seen[i].substeps, islands[i].substeps);
    EXPECT_EQ(std::isnan(seen[i].local_error), std::isnan(islands[i].local_error));
    if (!std::isnan(islands[i].local_error)) {
      EXPECT_EQ(seen[i].local_error, islands[i].local_error);
    }
  }
}

using WorldEdit = void (*)(World*);

// Edits, each of which leaves something for the next one.
const WorldEdit kEdits[] = {
    [](World* world) {
      Motor motor = world->joint(world->joint_ids().front()).motor;
      motor.timeout = 3.0;
      world->set_motor(world->joint_ids().front(), motor);
    },
    [](World* world) {
      world->add_body(make_body("newcomer", Sphere{0.2}, 1.0, {50.0, 0.0, 50.0}));
    },
    [](World* world) { world->set_broken(world->joint_ids().front(), true); },
    [](World* world) {
      const BodyId id = world->find_body("newcomer");
      BodyState state = world->state(id);
      state.position.x() += 1.0;
      world->set_state(id, state);
    },
    [](World* world) { world->remove_body(world->find_body("newcomer")); },
    [](World* world) { world->set_time(3.0, 7); },
    [](World* world) { world->reset(); },
};

TEST(Snapshot, AnswersAsItsWorldDoesAfterStepsAndEdits) {
  for (const char* scene : {"chain_heavy_end", "heavy_load", "bridge", "winch", "two_boxes"}) {
    for (const Method method : {Method::kAuto, Method::kSequentialImpulses}) {
      SCOPED_TRACE(std::string(scene) + " by " + name(method));
      World world = shipped(scene, method);
      World snapshot;
      const auto look = [&] {
        world.take_snapshot(&snapshot);
        expect_same_answers(snapshot, world);
        World first;
        world.take_snapshot(&first);  // nothing to reuse
        expect_same_answers(first, world);
      };
      look();
      for (const WorldEdit edit : kEdits) {
        for (int i = 0; i < 40; ++i) world.step();
        look();
        edit(&world);
        look();
        world.step();
        look();
      }
    }
  }
}

// Scenes in which a step meets nothing new and abandons no method: the answer before the step is
// the step's own.
TEST(Islands, AskedForAfterAnEditAreThoseOfTheNextStep) {
  const std::pair<const char*, Method> scenes[] =
      {
          {"chain_heavy_end", Method::kAuto}, {"winch", Method::kAuto},
          {"bridge", Method::kAuto},          {"two_boxes", Method::kRungeKutta},
          {"weak_winch", Method::kAuto},  // always in event-driven contact
      };
  for (const auto& [scene, method] : scenes) {
    SCOPED_TRACE(scene);
    World world = shipped(scene, method);
    for (const WorldEdit edit : kEdits) {
      for (int i = 0; i < 40; ++i) world.step();
      edit(&world);
      const World untouched = world;
      const std::vector<Island> asked = world.islands();
      ASSERT_EQ(world.state_hash(), untouched.state_hash());
      world.step();
      const std::vector<Island> taken = world.islands();
      ASSERT_EQ(asked.size(), taken.size());
      for (std::size_t i = 0; i < asked.size(); ++i) {
        EXPECT_EQ(asked[i].first_body, taken[i].first_body);
        EXPECT_EQ(asked[i].bodies, taken[i].bodies);
        EXPECT_EQ(asked[i].joints, taken[i].joints);
        EXPECT_EQ(asked[i].method, taken[i].method);
        EXPECT_EQ(asked[i].why, taken[i].why)
            << to_string(asked[i].why) << ", " << to_string(taken[i].why);
      }
    }
  }
}

TEST(Snapshot, ChangesNothing) {
  World world = shipped("bridge", Method::kAuto);
  World untouched = world;
  World snapshot;
  for (int i = 0; i < 50; ++i) {
    world.take_snapshot(&snapshot);
    world.step();
    untouched.step();
    ASSERT_EQ(world.state_hash(), untouched.state_hash()) << i;
  }
}

TEST(Snapshot, StepsOnAsAWorldThatWasSavedAndLoaded) {
  World world = shipped("bridge", Method::kAuto);
  for (int i = 0; i < 30; ++i) world.step();
  World snapshot;
  world.take_snapshot(&snapshot);
  World loaded = load_scene(save_scene(world));
  for (int i = 0; i < 30; ++i) {
    ASSERT_EQ(snapshot.state_hash(), loaded.state_hash()) << i;
    snapshot.step();
    loaded.step();
  }
}

TEST(Snapshot, IsTakenAnewIntoOneThatWasEdited) {
  World world = shipped("pendulum", Method::kAuto);
  world.step();
  World snapshot;
  world.take_snapshot(&snapshot);
  snapshot.add_body(make_body("stranger", Sphere{0.1}, 1.0, {9.0, 9.0, 9.0}));
  EXPECT_EQ(snapshot.islands().size(), world.islands().size() + 1);
  world.take_snapshot(&snapshot);
  EXPECT_FALSE(snapshot.has_body("stranger"));
  snapshot.step();
  world.take_snapshot(&snapshot);
  expect_same_answers(snapshot, world);
}

TEST(Snapshot, OfASnapshotIsTheSame) {
  World world = shipped("winch", Method::kAuto);
  for (int i = 0; i < 30; ++i) world.step();
  World snapshot, second;
  world.take_snapshot(&snapshot);
  snapshot.take_snapshot(&second);
  expect_same_answers(second, world);
  const World& same = second;
  same.take_snapshot(&second);  // into itself
  expect_same_answers(second, world);
}

}  // namespace
}  // namespace constraint_sim::engine
