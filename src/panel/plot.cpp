#include "panel/plot.h"

#include <QPainter>
#include <QPolygonF>
#include <algorithm>
#include <cmath>
#include <utility>

namespace constraint_sim::panel {

Plot::Plot(const QString& title, double least, std::vector<Line> lines, QWidget* parent)
    : QWidget(parent), title_(title), least_(least), lines_(std::move(lines)) {
  setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Expanding);
  setAccessibleName(title);
}

double Plot::logarithm(double value) const { return std::log10(std::max(value, least_)); }

// Returns the range in whole decades, at least two.
Plot::Range Plot::range() const {
  double low = std::log10(least_) + 2.0, high = std::log10(least_);
  bool is_first = true;
  for (const History::Point& point : history_.points()) {
    for (const double value : point.values) {
      if (!std::isfinite(value)) continue;
      low = is_first ? logarithm(value) : std::min(low, logarithm(value));
      high = is_first ? logarithm(value) : std::max(high, logarithm(value));
      is_first = false;
    }
  }
  if (is_first) std::swap(low, high);
  return {std::floor(low), std::max(std::ceil(high), std::floor(low) + 2.0)};
}

void Plot::draw_grid(QPainter* painter, const QRectF& area, const Range& range) const {
  const double decades = range.high - range.low, step = std::max(1.0, std::ceil(decades / 4.0));
  for (double decade = range.low; decade <= range.high; decade += step) {
    const double y = area.bottom() - area.height() * (decade - range.low) / decades;
    painter->setPen(palette().color(QPalette::Mid));
    painter->drawLine(QPointF(area.left(), y), QPointF(area.right(), y));
    painter->setPen(palette().color(QPalette::WindowText));
    painter->drawText(QRectF(0.0, y - 8.0, area.left() - 4.0, 16.0),
                      Qt::AlignRight | Qt::AlignVCenter, QStringLiteral("1e%1").arg(decade));
  }
}

void Plot::draw_line(QPainter* painter, const QRectF& area, const Range& range,
                     std::size_t line) const {
  const double last = history_.points().back().time;
  QPolygonF polygon;
  for (const History::Point& point : history_.points()) {
    if (!std::isfinite(point.values[line])) continue;
    polygon << QPointF(area.right() - area.width() * (last - point.time) / History::kSpan,
                       area.bottom() - area.height() * (logarithm(point.values[line]) - range.low) /
                                           (range.high - range.low));
  }
  painter->setPen(QPen(lines_[line].color, 1.5));
  painter->drawPolyline(polygon);
}

void Plot::draw_legend(QPainter* painter, const QRectF& area) const {
  QRectF place(area.left(), 0.0, area.width(), area.top());
  painter->setPen(palette().color(QPalette::WindowText));
  painter->drawText(place, Qt::AlignLeft | Qt::AlignVCenter, title_);
  for (auto line = lines_.rbegin(); line != lines_.rend(); ++line) {
    QString text = line->name;
    if (!history_.points().empty())
      text += QStringLiteral(" %1").arg(
          history_.points().back().values[static_cast<std::size_t>(lines_.rend() - line) - 1], 0,
          'g', 3);
    painter->setPen(line->color);
    QRectF drawn;
    painter->drawText(place, Qt::AlignRight | Qt::AlignVCenter, text, &drawn);
    place.setRight(drawn.left() - 8.0);
  }
}

void Plot::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.setRenderHint(QPainter::Antialiasing);
  const int margin = painter.fontMetrics().height() + 4;
  const QRectF area = QRectF(rect()).adjusted(3.2 * margin, margin, -4.0, -6.0);
  const Range shown = range();
  draw_grid(&painter, area, shown);
  draw_legend(&painter, area);
  if (history_.points().empty()) return;
  painter.setClipRect(area.adjusted(-1.0, -1.0, 1.0, 1.0));
  for (std::size_t line = 0; line < lines_.size(); ++line) draw_line(&painter, area, shown, line);
}

}  // namespace constraint_sim::panel
