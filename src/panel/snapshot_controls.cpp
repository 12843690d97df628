#include "panel/snapshot_controls.h"

#include <constraint_sim/RestoreSnapshot.h>
#include <constraint_sim/SaveSnapshot.h>

#include <QGridLayout>
#include <algorithm>

#include "panel/widgets.h"

namespace constraint_sim::panel {

SnapshotControls::SnapshotControls(Client& client, QWidget* parent)
    : QWidget(parent), client_(client) {
  slider_ = named(new QSlider(Qt::Horizontal, this), "Snapshot",
                  "The snapshot that Rewind goes back to; the newest is on the right");
  slider_->setPageStep(10);
  connect(slider_, &QSlider::valueChanged, [this] { show_chosen(); });
  chosen_ = new QLabel(this);
  interval_ = named(new QDoubleSpinBox(this), "Snapshot interval",
                    "Wall time between snapshots that the panel keeps while the world runs");
  interval_->setRange(0.0, 1000.0);
  interval_->setDecimals(1);
  interval_->setSuffix(" s");
  interval_->setSpecialValueText("never");

  auto* const grid = new QGridLayout(this);
  grid->setContentsMargins(0, 0, 0, 0);
  grid->setColumnStretch(0, 1);
  grid->addWidget(slider_, 0, 0, 1, 2);
  grid->addWidget(make_button("Rew&ind", "restore_snapshot", this, [this] { rewind(); }), 0, 2);
  grid->addWidget(chosen_, 1, 0);
  grid->addWidget(interval_, 1, 1);
  grid->addWidget(
      make_button("&Keep", "save_snapshot, into the ring of 100", this, [this] { keep(false); }), 1,
      2);
  show_chosen();
}

void SnapshotControls::refresh() {
  client_.poll<ListSnapshots>("list_snapshots", ListSnapshotsRequest(),
                              [this](const auto& response) { show_list(response); });
}

void SnapshotControls::tick(bool is_running) {
  const auto now = std::chrono::steady_clock::now();
  const std::chrono::duration<double> since = now - last_kept_;
  if (!is_running || interval() == 0.0 || since.count() < interval()) return;
  last_kept_ = now;
  keep(true);
}

void SnapshotControls::keep(bool is_poll) {
  const auto then = [this](const SaveSnapshotResponse&) { refresh(); };
  const SaveSnapshotRequest request;
  if (is_poll)
    client_.poll<SaveSnapshot>("save_snapshot", request, then);
  else
    client_.call<SaveSnapshot>(Queue::kQueries, "save_snapshot", "", request, then);
}

// Shows the list. A chosen snapshot stays chosen; with the newest chosen, the new newest is.
void SnapshotControls::show_list(const ListSnapshotsResponse& list) {
  const int last = static_cast<int>(list_.names.size()) - 1,
            newest = static_cast<int>(list.names.size()) - 1;
  int chosen = newest;
  if (last >= 0 && slider_->value() < last) {
    const std::string& name = list_.names[static_cast<std::size_t>(slider_->value())];
    const auto same = std::find(list.names.begin(), list.names.end(), name);
    chosen = same == list.names.end() ? 0 : static_cast<int>(same - list.names.begin());
  }
  list_ = list;
  slider_->setRange(0, std::max(0, newest));
  slider_->setValue(std::max(0, chosen));
  show_chosen();
}

void SnapshotControls::show_chosen() {
  const auto i = static_cast<std::size_t>(slider_->value());
  slider_->setEnabled(!list_.names.empty());
  chosen_->setText(i < list_.names.size() ? QStringLiteral("%1: %2 s, step %3")
                                                .arg(QString::fromStdString(list_.names[i]))
                                                .arg(list_.sim_times[i])
                                                .arg(list_.steps[i])
                                          : QStringLiteral("no snapshot"));
}

void SnapshotControls::rewind() {
  const auto i = static_cast<std::size_t>(slider_->value());
  RestoreSnapshotRequest request;
  // The node rejects the empty name with a message.
  if (i < list_.names.size()) request.name = list_.names[i];
  client_.call<RestoreSnapshot>(Queue::kEdits, "restore_snapshot", request.name, request);
}

}  // namespace constraint_sim::panel
