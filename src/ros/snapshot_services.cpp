#include "ros/snapshot_services.h"

#include <chrono>
#include <memory>
#include <stdexcept>
#include <utility>

#include "constraint_sim/engine/snapshot.h"
#include "ros/answer.h"
#include "ros/guarded.h"
#include "ros/time_conversions.h"
#include "sim/files.h"

namespace constraint_sim {

SnapshotServices::SnapshotServices(Stepper& stepper, EditLog& edit_log,
                                   const Parameters& parameters, ros::NodeHandle edits,
                                   ros::NodeHandle queries)
    : stepper_(stepper), edit_log_(edit_log), parameters_(parameters) {
  servers_ = {guarded_service(queries, "save_snapshot", &SnapshotServices::save, this),
              guarded_service(edits, "restore_snapshot", &SnapshotServices::restore, this),
              guarded_service(queries, "list_snapshots", &SnapshotServices::list, this)};
}

std::string SnapshotServices::place(const std::string& path) const {
  const std::string& folder = parameters_.scene_folder;
  return folder.empty() ? path : path_below(folder, path);
}

// Reads a snapshot file; one at a time, since each may take a GiB.
World SnapshotServices::read(const std::string& path) {
  constexpr auto kPatience = std::chrono::milliseconds(500);
  const std::unique_lock<std::timed_mutex> lock(reading_, kPatience);
  if (!lock) throw NotNow("path: not now, another file is being restored");
  return engine::read_snapshot(read_file(path, Snapshots::kMostBytes, [](const std::string& start) {
    if (!engine::is_snapshot(start)) throw engine::SnapshotError("snapshot: is none");
  }));
}

// Saves a snapshot. The stepping thread only copies the world.
bool SnapshotServices::save(SaveSnapshotRequest& request, SaveSnapshotResponse& response) {
  return answer(response, [&] {
    if (!request.name.empty() && !request.path.empty())
      throw std::invalid_argument("name, path: at most one of the two, got both");
    World world;
    stepper_.inspect([&](const World& now) { world = now; });
    auto bytes = std::make_shared<const std::string>(engine::write_snapshot(world));
    response.sim_time = world.time();
    response.step = world.step_count();
    response.state_hash = world.state_hash();
    if (request.path.empty())
      response.name = snapshots_.keep({request.name, false, world.time(), world.step_count(),
                                       response.state_hash, std::move(bytes)});
    else
      write_file(place(request.path), *bytes);
  });
}

bool SnapshotServices::restore(RestoreSnapshotRequest& request, RestoreSnapshotResponse& response) {
  return answer(response, [&] {
    if (request.name.empty() == request.path.empty())
      throw std::invalid_argument("name, path: exactly one of the two is needed");
    World restored = request.path.empty() ? engine::read_snapshot(*snapshots_.bytes(request.name))
                                          : read(place(request.path));
    response.state_hash = restored.state_hash();
    const Boundary boundary = stepper_.interrupt("restore_snapshot", [&](World& world) {
      restored.reserve_ids(world);
      world = std::move(restored);
      edit_log_.record_replaced(stepper_, world);
    });
    response.applied_at = time_from_seconds(boundary.time);
    response.step = boundary.step;
  });
}

bool SnapshotServices::list(ListSnapshotsRequest&, ListSnapshotsResponse& response) {
  return answer(response, [&] {
    for (const Snapshots::Snapshot& snapshot : snapshots_.list()) {
      response.names.push_back(snapshot.name);
      response.sim_times.push_back(snapshot.time);
      response.steps.push_back(snapshot.step);
      response.state_hashes.push_back(snapshot.hash);
    }
  });
}

}  // namespace constraint_sim
