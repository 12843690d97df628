#pragma once

#include <constraint_sim/ListSnapshots.h>
#include <constraint_sim/RestoreSnapshot.h>
#include <constraint_sim/SaveSnapshot.h>
#include <ros/node_handle.h>

#include <vector>

#include "ros/edit_log.h"
#include "ros/parameters.h"
#include "ros/snapshots.h"
#include "sim/stepper.h"

namespace constraint_sim {

/// Services that save the stepper's world exactly to the bit, and restore it.
class SnapshotServices {
 public:
  /// `edits`: handle of services that edit; `queries`: handle of the others.
  SnapshotServices(Stepper& stepper, EditLog& edit_log, const Parameters& parameters,
                   ros::NodeHandle edits, ros::NodeHandle queries);

 private:
  bool save(SaveSnapshotRequest& request, SaveSnapshotResponse& response);
  bool restore(RestoreSnapshotRequest& request, RestoreSnapshotResponse& response);
  bool list(ListSnapshotsRequest& request, ListSnapshotsResponse& response);
  std::string place(const std::string& path) const;
  World read(const std::string& path);

  Stepper& stepper_;
  EditLog& edit_log_;
  Parameters parameters_;
  Snapshots snapshots_;
  std::timed_mutex reading_;
  std::vector<ros::ServiceServer> servers_;
};

}  // namespace constraint_sim
