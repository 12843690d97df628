#include "panel/panel.h"

#include <ros/exceptions.h>
#include <rviz/visualization_manager.h>

#include <QHBoxLayout>
#include <QHeaderView>
#include <QTime>
#include <QVBoxLayout>
#include <pluginlib/class_list_macros.hpp>

#include "panel/widgets.h"

namespace constraint_sim::panel {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kTick = 100;         // period of updates [ms]
constexpr double kQuestion = 1.0;  // period of requests for the state [s]
constexpr double kPatience = 1.0;  // time after which a waiting call is shown [s]
constexpr int kMostMessages = 200;
constexpr int kStateLines = 3;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

}  // namespace

Panel::Panel(QWidget* parent)
    : rviz::Panel(parent),
      node_name_("/constraint_sim"),
      view_([this](bool success, const QString& why) { say(success, why); }) {
  node_ = named(new QLineEdit(node_name_, this), "Node",
                "Name of the simulator's node; the return key connects anew and gives up calls");
  connect(node_, &QLineEdit::returnPressed, [this] { connect_to_node(); });
  state_ = new QLabel(this);
  state_->setWordWrap(true);
  // The height is fixed, so that buttons do not move under the pointer.
  state_->setAlignment(Qt::AlignLeft | Qt::AlignTop);
  state_->setFixedHeight(kStateLines * state_->fontMetrics().lineSpacing());
  run_ = new RunControls(client_, this);
  scene_ = new SceneControls(client_, this);
  snapshots_ = new SnapshotControls(client_, this);
  record_ = new RecordControls(
      client_, [this](bool success, const QString& message) { say(success, message); }, this);
  build_tabs();
  messages_ = named(new QPlainTextEdit(this), "Messages", "What became of calls");
  messages_->setReadOnly(true);
  messages_->setMaximumBlockCount(kMostMessages);
  messages_->setMaximumHeight(90);

  auto* const column = new QVBoxLayout(this);
  auto* const row = new QHBoxLayout();
  row->addWidget(new QLabel("Node", this));
  row->addWidget(node_);
  column->addLayout(row);
  for (QWidget* const widget :
       std::initializer_list<QWidget*>{state_, run_, scene_, snapshots_, record_})
    column->addWidget(widget);
  column->addWidget(tabs_, 1);
  column->addWidget(messages_);
  connect(&timer_, &QTimer::timeout, [this] { tick(); });
}

void Panel::build_tabs() {
  tabs_ = new QTabWidget(this);
  plots_ = new QWidget(tabs_);
  auto* const plots = new QVBoxLayout(plots_);
  plots->setContentsMargins(0, 0, 0, 0);
  error_plot_ = new Plot("Worst error [m]", 1e-16, {{"", QColor(200, 40, 40)}}, plots_);
  time_plot_ = new Plot("Run time [ms]", 1e-4,
                        {{"mean", QColor(30, 110, 200)}, {"max", QColor(230, 140, 20)}}, plots_);
  plots->addWidget(error_plot_);
  plots->addWidget(time_plot_);
  tree_ = named(new QTreeView(tabs_), "World tree", "Bodies and constraints");
  tree_->setModel(&model_);
  tree_->setUniformRowHeights(true);  // fast for thousands of rows
  for (int column = 0; column < WorldModel::kColumns; ++column)
    tree_->setColumnWidth(column, column == WorldModel::kState ? 130 : 72);
  tree_->expandAll();
  motors_ = new MotorList(client_, tabs_);
  tabs_->addTab(plots_, "Plots");
  tabs_->addTab(tree_, "World");
  tabs_->addTab(motors_, "Motors");
  tabs_->setMinimumHeight(180);
}

// Starts the panel; the configuration, if any, has been read.
void Panel::onInitialize() {
  if (isVisible()) showEvent(nullptr);
}

void Panel::load(const rviz::Config& config) {
  rviz::Panel::load(config);
  QString text, file;
  if (config.mapGetString("Node", &text)) node_->setText(text);
  const QString bag = config.mapGetString("Bag", &text) ? text : record_->bag();
  record_->set_bag(bag);
  const QString scene = config.mapGetString("Scene", &text) ? text : scene_->scene();
  scene_->set(scene, config.mapGetString("Scene File", &file) ? file : scene_->file());
  float interval = 0.0F;
  if (config.mapGetFloat("Snapshot Interval", &interval))
    snapshots_->set_interval(static_cast<double>(interval));
  if (is_connected_) connect_to_node();
}

void Panel::save(rviz::Config config) const {
  rviz::Panel::save(config);
  config.mapSetValue("Node", node_->text() == shown_node() ? node_name_ : node_->text());
  config.mapSetValue("Bag", record_->bag());
  config.mapSetValue("Scene", scene_->scene());
  config.mapSetValue("Scene File", scene_->file());
  config.mapSetValue("Snapshot Interval", snapshots_->interval());
}

QString Panel::shown_node() const { return QString::fromStdString(client_.node()); }

void Panel::connect_to_node() {
  is_connected_ = is_in_contact_ = false;
  no_contact_.clear();
  properties_ = GetWorldPropertiesResponse();
  model_.set_bodies(nullptr);
  model_.set_constraints(nullptr);
  error_plot_->history().clear();
  time_plot_->history().clear();
  try {
    const QString name = node_->text();
    const bool is_new = name != node_name_ && name != shown_node();
    client_.connect(name.toStdString());
    is_connected_ = true;
    if (is_new) {
      node_name_ = name;
      Q_EMIT configChanged();
    }
    node_->setText(shown_node());
    ask_for_state();
  } catch (const ros::InvalidNameException& error) {
    say(false, QString("node: ") + error.what());
  }
}

void Panel::showEvent(QShowEvent* event) {
  if (event != nullptr) rviz::Panel::showEvent(event);
  if (!is_connected_) connect_to_node();
  timer_.start(kTick);
}

void Panel::hideEvent(QHideEvent* event) {
  rviz::Panel::hideEvent(event);
  timer_.stop();
  if (is_connected_) client_.want(Topics::Wanted());
}

void Panel::tick() {
  record_->tick();
  if (!is_connected_) return;
  want_topics();
  show_news();
  show_outcomes();
  if (seconds_since(last_question_) > kQuestion) ask_for_state();
  snapshots_->tick(is_in_contact_ && !properties_.paused);
  show_state();
}

// Subscribes to the topics of the front tab only.
void Panel::want_topics() {
  Topics::Wanted wanted;
  const QWidget* const front = tabs_->currentWidget();
  wanted.statistics = wanted.scenes = true;
  wanted.bodies = front == tree_;
  wanted.constraints = front == tree_ || front == motors_;
  client_.want(wanted);
}

void Panel::show_news() {
  const Topics::News news = client_.take_news();
  const double now = std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
  for (const StatisticsConstPtr& statistics : news.statistics) {
    measured_factor_ = statistics->real_time_factor;
    if (statistics->ticks == 0) continue;
    error_plot_->history().add(now, {statistics->max_constraint_error});
    time_plot_->history().add(now, {1e3 * statistics->wall_mean, 1e3 * statistics->wall_max});
  }
  if (!news.statistics.empty() && plots_->isVisible()) {
    error_plot_->update();
    time_plot_->update();
  }
  if (news.scene) scene_->show_running(QString::fromStdString(*news.scene));
  if (news.is_scene_new) view_.frame(client_.node(), vis_manager_);
  if (news.bodies) model_.set_bodies(news.bodies);
  if (news.constraints) {
    if (tree_->isVisible()) model_.set_constraints(news.constraints);
    if (motors_->isVisible()) motors_->follow(news.constraints);
  }
}

void Panel::show_outcomes() {
  bool is_changed = false;
  for (const Outcome& outcome : client_.take_outcomes()) {
    if (outcome.then) outcome.then();
    if (outcome.is_poll && outcome.what == "get_world_properties" && !outcome.success) {
      is_in_contact_ = false;
      no_contact_ = outcome.message;
    }
    if (outcome.is_poll) continue;
    is_changed = true;
    QString text = QString::fromStdString(outcome.what + ": ") + (outcome.success ? "done" : "");
    if (!outcome.message.empty())
      text += (outcome.success ? ", " : "") + QString::fromStdString(outcome.message);
    say(outcome.success, text);
  }
  if (is_changed) {
    ask_for_state();
    snapshots_->refresh();
    if (motors_->isVisible()) motors_->refresh();
  }
}

void Panel::ask_for_state() {
  last_question_ = Clock::now();
  client_.poll<GetWorldProperties>("get_world_properties", GetWorldPropertiesRequest(),
                                   [this](const auto& response) {
                                     properties_ = response;
                                     if (!is_in_contact_) on_contact();
                                   });
}

void Panel::on_contact() {
  is_in_contact_ = true;
  // The node alone knows settings that were changed since its start.
  client_.read_parameter("real_time_factor",
                         [this](double factor) { run_->show_real_time_factor(factor); });
  scene_->refresh();
  snapshots_->refresh();
  if (motors_->isVisible()) motors_->refresh();
}

void Panel::show_state() {
  QString text;
  if (is_in_contact_) {
    text = QStringLiteral("%1 at %2 s, step %3; bodies %4, constraints %5")
               .arg(properties_.paused ? "paused" : "running")
               .arg(properties_.sim_time, 0, 'f', 2)
               .arg(properties_.step)
               .arg(properties_.bodies.size())
               .arg(properties_.constraints.size());
    if (!properties_.paused) text += QStringLiteral("; speed %1").arg(measured_factor_, 0, 'g', 3);
  } else {
    text = no_contact_.empty() ? "looking for " + QString::fromStdString(client_.node())
                               : "no contact: " + QString::fromStdString(no_contact_);
  }
  const auto waiting = client_.waiting();
  if (waiting && waiting->seconds > kPatience)
    text += QStringLiteral("; waiting for %1 since %2 s")
                .arg(QString::fromStdString(waiting->what))
                .arg(static_cast<int>(waiting->seconds));
  if (state_->text() == text) return;
  state_->setText(text);
  state_->setToolTip(text);  // the whole text, which may exceed the visible lines
}

void Panel::say(bool success, const QString& message) {
  const QString line = QTime::currentTime().toString("hh:mm:ss ") + message.toHtmlEscaped();
  messages_->appendHtml(success ? line : "<span style=\"color:#c02020\">" + line + "</span>");
}

}  // namespace constraint_sim::panel

PLUGINLIB_EXPORT_CLASS(constraint_sim::panel::Panel, rviz::Panel)
