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

// The edits that services make: one function each, and one list of all. Advertising, the edit log
// and its replay use the list.

/// Calls visit(name, static_cast<Service*>(nullptr)) for each service whose request only edits the
/// world.
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

// Each function fills in the response beyond the common fields. It throws std::invalid_argument for
// an invalid request and has then changed nothing. A long edit throws NotNow once the world is
// asked to stop.
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

/// Returns the request of set_motor_bias that a message on the topic motor_bias stands for.
SetMotorBiasRequest request_of(const MotorBias& message);

/// Returns the number of edits in one request.
std::size_t size(const ApplyEditsRequest& request);
/// Rejects a request of too many edits.
void check_size(const ApplyEditsRequest& request);

void reset_world(World& world);
void reset_simulation(World& world);

/// Applies a record of edit_log. Throws std::invalid_argument for an unknown service or a malformed
/// request.
void apply_recorded(World& world, const std::string& service,
                    const std::vector<std::uint8_t>& request);

/// Service name of records that hold changes by trajectories, commands, twists and wrenches, as
/// written by bytes_of().
inline constexpr const char* kDriveRecord = "drive";
std::vector<std::uint8_t> bytes_of(const DriveChanges& changes);

/// Settings of set_options() that belong to the node, not to the world.
struct Pacing {
  std::optional<double> real_time_factor, publish_rate;
};
Pacing pacing(const SetOptionsRequest& request);

}  // namespace constraint_sim
