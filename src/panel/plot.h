#pragma once

#include <QColor>
#include <QString>
#include <QWidget>
#include <vector>

#include "panel/history.h"

namespace constraint_sim::panel {

/// A plot of lines over time, with decades on the vertical axis.
class Plot : public QWidget {
 public:
  struct Line {
    QString name;
    QColor color;
  };

  Plot(const QString& title, double least, std::vector<Line> lines, QWidget* parent);

  History& history() { return history_; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  QSize minimumSizeHint() const override { return {160, 70}; }

 private:
  struct Range {
    double low, high;  // decimal logarithms
  };
  Range range() const;
  double logarithm(double value) const;
  void draw_grid(QPainter* painter, const QRectF& area, const Range& range) const;
  void draw_line(QPainter* painter, const QRectF& area, const Range& range, std::size_t line) const;
  void draw_legend(QPainter* painter, const QRectF& area) const;

  QString title_;
  double least_;  // smaller values are drawn at this value
  std::vector<Line> lines_;
  History history_;
};

}  // namespace constraint_sim::panel
