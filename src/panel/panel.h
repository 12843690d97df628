#pragma once

#include <constraint_sim/GetWorldProperties.h>
#include <rviz/panel.h>

#include <QLabel>
#include <QLineEdit>
#include <QPlainTextEdit>
#include <QTabWidget>
#include <QTimer>
#include <QTreeView>
#include <chrono>

#include "panel/client.h"
#include "panel/motor_list.h"
#include "panel/plot.h"
#include "panel/record_controls.h"
#include "panel/run_controls.h"
#include "panel/scene_controls.h"
#include "panel/scene_view.h"
#include "panel/snapshot_controls.h"
#include "panel/world_model.h"

namespace constraint_sim::panel {

/// Panel of rviz that shows state and costs of a simulator and controls it. A hidden panel has no
/// subscriptions and makes no calls.
class Panel : public rviz::Panel {
 public:
  explicit Panel(QWidget* parent = nullptr);

  void onInitialize() override;
  void load(const rviz::Config& config) override;
  void save(rviz::Config config) const override;

 protected:
  void showEvent(QShowEvent* event) override;
  void hideEvent(QHideEvent* event) override;

 private:
  void build_tabs();
  QString shown_node() const;  ///< the name of the node as ROS resolves it
  void connect_to_node();
  void tick();
  void want_topics();
  void show_news();
  void show_outcomes();
  void show_state();
  void ask_for_state();
  void on_contact();
  void say(bool success, const QString& message);

  Client client_;
  QString node_name_;  // name that the user typed or configured, which ROS resolves
  bool is_connected_ = false;
  bool is_in_contact_ = false;
  std::string no_contact_;  // reason why the node is not reached
  GetWorldPropertiesResponse properties_;
  double measured_factor_ = 0.0;
  SceneView view_;
  std::chrono::steady_clock::time_point last_question_;

  QTimer timer_;
  QLineEdit* node_;
  QLabel* state_;
  RunControls* run_;
  SceneControls* scene_;
  RecordControls* record_;
  SnapshotControls* snapshots_;
  QTabWidget* tabs_;
  QWidget* plots_;
  Plot* error_plot_;
  Plot* time_plot_;
  QTreeView* tree_;
  WorldModel model_;
  MotorList* motors_;
  QPlainTextEdit* messages_;
};

}  // namespace constraint_sim::panel
