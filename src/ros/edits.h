#pragma once

#include <constraint_sim/AddBody.h>
#include <constraint_sim/AddConstraint.h>
#include <constraint_sim/AddDistanceConstraint.h>
#include <constraint_sim/ApplyBodyWrench.h>
#include <constraint_sim/ApplyEdits.h>
#include <constraint_sim/ClearBodyWrenches.h>
#include <constraint_sim/MotorBias.h>
#include <constraint_sim/RemoveBody.h>
#include <constraint_sim/RemoveConstraint.h>
#include <constraint_sim/SetBodyProperties.h>
#include <constraint_sim/SetBodyState.h>
#include <constraint_sim/SetConstraintProperties.h>
#include <constraint_sim/SetMotorBias.h>
#include <constraint_sim/SetOptions.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "constraint_sim/engine/world.h"
#include "sim/drive_changes.h"

namespace constraint_sim {

// What services do to a world: one function each, and one list of all. Advertising, the edit log
// and its replay go by that list.

/// Calls visit(name, static_cast<Service*>(nullptr)) for each service whose request is an edit of
/// the world and nothing else.
template <class Visit>
void visit_edits(Visit visit) {
  visit("add_body", static_cast<AddBody*>(nullptr));
  visit("remove_body", static_cast<RemoveBody*>(nullptr));
  visit("add_distance_constraint", static_cast<AddDistanceConstraint*>(nullptr));
  visit("add_constraint", static_cast<AddConstraint*>(nullptr));
  visit("remove_constraint", static_cast<RemoveConstraint*>(nullptr));
  visit("set_motor_bias", static_cast<SetMotorBias*>(nullptr));
  visit("set_constraint_properties", static_cast<SetConstraintProperties*>(nullptr));
  visit("apply_body_wrench", static_cast<ApplyBodyWrench*>(nullptr));
  visit("clear_body_wrenches", static_cast<ClearBodyWrenches*>(nullptr));
  visit("set_body_state", static_cast<SetBodyState*>(nullptr));
  visit("apply_edits", static_cast<ApplyEdits*>(nullptr));
  visit("set_body_properties", static_cast<SetBodyProperties*>(nullptr));
  visit("set_options", static_cast<SetOptions*>(nullptr));
}

// Each fills in what its answer has beyond the common fields. Throws std::invalid_argument for what
// cannot be, and has then changed nothing. A long one throws NotNow once the world is asked to
// stop.
using engine::World;
void change(World& world, const AddBodyRequest& request, AddBodyResponse* response);
void change(World& world, const RemoveBodyRequest& request, RemoveBodyResponse* response);
void change(World& world, const AddDistanceConstraintRequest& request,
            AddDistanceConstraintResponse* response);
void change(World& world, const AddConstraintRequest& request, AddConstraintResponse* response);
void change(World& world, const RemoveConstraintRequest& request,
            RemoveConstraintResponse* response);
void change(World& world, const SetMotorBiasRequest& request, SetMotorBiasResponse* response);
void change(World& world, const SetConstraintPropertiesRequest& request,
            SetConstraintPropertiesResponse* response);
void change(World& world, const ApplyBodyWrenchRequest& request, ApplyBodyWrenchResponse* response);
void change(World& world, const ClearBodyWrenchesRequest& request,
            ClearBodyWrenchesResponse* response);
void change(World& world, const SetBodyStateRequest& request, SetBodyStateResponse* response);
void change(World& world, const ApplyEditsRequest& request, ApplyEditsResponse* response);
void change(World& world, const SetBodyPropertiesRequest& request,
            SetBodyPropertiesResponse* response);
void change(World& world, const SetOptionsRequest& request, SetOptionsResponse* response);

/// The request of set_motor_bias that a message of the topic motor_bias stands for.
SetMotorBiasRequest request_of(const MotorBias& message);

/// The number of edits in one request.
std::size_t size(const ApplyEditsRequest& request);

void reset_world(World& world);
void reset_simulation(World& world);

/// Does again what a record of edit_log says; throws std::invalid_argument for a service that is
/// not here, or a request that is not one of it.
void apply_recorded(World& world, const std::string& service,
                    const std::vector<std::uint8_t>& request);

/// The service of a record of changes by what drives bodies and joints, with bytes_of() them.
inline constexpr const char* kDriveRecord = "drive";
std::vector<std::uint8_t> bytes_of(const DriveChanges& changes);

/// What set_options() sets beside the world.
struct Pacing {
  std::optional<double> real_time_factor, publish_rate;
};
Pacing pacing(const SetOptionsRequest& request);

}  // namespace constraint_sim
