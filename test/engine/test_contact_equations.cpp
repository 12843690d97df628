// Equations of a group of touching bodies, without a world around them.

#include <gtest/gtest.h>

#include "engine/methods/event_driven/contacts/contact_equations.h"

namespace constraint_sim::engine {
namespace {

/// Equations of a ball of 1 kg that touches the ground.
ContactEquations ball_on_ground() {
  ContactEquations equations;
  for (const int index : {0, 1}) equations.bodies().list().emplace_back().index = index;
  for (const std::size_t body : {0u, 1u}) equations.bodies().shapes().add(Body{}, body, 0);
  equations.bodies().list()[0].mass.inverse_mass = 1.0;
  equations.bodies().set_movable(1);
  ContactEquations::Contact& contact = equations.contacts().emplace_back();
  contact.a = 0;
  contact.b = 1;
  contact.shape_index_a = 0;
  contact.shape_index_b = 1;
  contact.acts = ContactEquations::Acts::kSticks;
  contact.feature.id = 1;
  List<BodyState> states(2);
  states[0].position.z() = 0.1;
  equations.bodies().gather(states, 0.0);
  equations.prepare_stages();
  return equations;
}

// A substep that is taken back has applied no impulse. So the feature of the last impulse, where a
// contact that opens again is reported, has to be the feature from before the substep.
TEST(ContactEquations, ASubstepThatIsTakenBackLeavesTheFeatureOfTheLastImpulse) {
  ContactEquations equations = ball_on_ground();
  ContactEquations::Contact& contact = equations.contacts()[0];
  equations.accept_stillness(0.01);
  ASSERT_EQ(contact.touched.id, 1u);
  contact.feature.id = 2;
  equations.keep();
  equations.accept_stillness(0.01);
  ASSERT_EQ(contact.touched.id, 2u);
  equations.restore();
  EXPECT_EQ(contact.touched.id, 1u);
}

}  // namespace
}  // namespace constraint_sim::engine
