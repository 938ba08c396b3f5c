#include "engine/render/transfer_function.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

#include <nlohmann/json.hpp>

namespace fovea::render {
namespace {

constexpr size_t kMaxPoints = 4096;
/// Opacity 1 would need infinite extinction; this transmits 2^-24, less than a float can show.
constexpr double kMostOpacity = 1.0 - 1.0 / (1 << 24);

bool IsUnit(float x) {
  return x >= 0.0F && x <= 1.0F;
}

/// Splits off the text before `separator`, or all of it.
std::string_view TakeUntil(std::string_view* text, char separator) {
  const size_t at = text->find(separator);
  const std::string_view head = text->substr(0, at);
  *text = at == std::string_view::npos ? std::string_view() : text->substr(at + 1);
  return head;
}

template <typename Number>
std::optional<Number> ParseNumber(std::string_view text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    return std::nullopt;
  }
  return value;
}

std::optional<TransferFunction::Point> ParsePoint(std::string_view text) {
  const auto value = ParseNumber<double>(TakeUntil(&text, ':'));
  std::string_view color = TakeUntil(&text, ':');
  const auto red = ParseNumber<float>(TakeUntil(&color, ','));
  const auto green = ParseNumber<float>(TakeUntil(&color, ','));
  const auto blue = ParseNumber<float>(color);
  const auto opacity = ParseNumber<float>(text);
  if (!value || !red || !green || !blue || !opacity) {
    return std::nullopt;
  }
  return TransferFunction::Point{*value, {*red, *green, *blue}, *opacity};
}

StatusOr<TransferFunction> ParseJson(std::string_view text) {
  const auto bad = [](std::string_view why) {
    return InvalidArgument(
        "transfer function: {}; expected [{{\"value\": V, \"color\": [R, G, B], \"opacity\": A}}, "
        "...]",
        why);
  };
  const auto json = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_array()) {
    return bad("the JSON is not a list");
  }
  TransferFunction transfer;
  for (const auto& item : json) {
    if (!item.is_object() || !item.contains("value") || !item["value"].is_number() ||
        !item.contains("opacity") || !item["opacity"].is_number() || !item.contains("color") ||
        !item["color"].is_array() || item["color"].size() != 3 ||
        !std::all_of(item["color"].begin(), item["color"].end(),
                     [](const auto& c) { return c.is_number(); })) {
      return bad(fmt::format("point {} is not complete", transfer.points.size()));
    }
    transfer.points.push_back({item["value"].get<double>(),
                               {item["color"][0].get<float>(), item["color"][1].get<float>(),
                                item["color"][2].get<float>()},
                               item["opacity"].get<float>()});
  }
  return transfer;
}

}  // namespace

Status Validate(const TransferFunction& transfer) {
  const auto& points = transfer.points;
  if (points.empty() || points.size() > kMaxPoints) {
    return InvalidArgument("transfer_function has {} points; it must have 1 to {}", points.size(),
                           kMaxPoints);
  }
  for (size_t i = 0; i < points.size(); ++i) {
    const TransferFunction::Point& p = points[i];
    if (!std::isfinite(p.value)) {
      return InvalidArgument("transfer_function.points[{}].value is not a finite number", i);
    }
    if (i > 0 && p.value < points[i - 1].value) {
      return InvalidArgument(
          "transfer_function.points[{}].value {} is less than the point before it, {}; values must "
          "not decrease",
          i, p.value, points[i - 1].value);
    }
    if (!IsUnit(p.color.red) || !IsUnit(p.color.green) || !IsUnit(p.color.blue)) {
      return InvalidArgument(
          "transfer_function.points[{}].color {},{},{} is outside its range, 0 to 1", i,
          p.color.red, p.color.green, p.color.blue);
    }
    if (!IsUnit(p.opacity)) {
      return InvalidArgument(
          "transfer_function.points[{}].opacity {} is outside its range, 0 to 1 per voxel length",
          i, p.opacity);
    }
  }
  return absl::OkStatus();
}

StatusOr<TransferFunction> ParseTransferFunction(std::string_view text) {
  TransferFunction transfer;
  const size_t start = text.find_first_not_of(" \t\r\n");
  if (start != std::string_view::npos && text[start] == '[') {
    FOVEA_ASSIGN_OR_RETURN(transfer, ParseJson(text));
  } else {
    while (!text.empty()) {
      const std::string_view item = TakeUntil(&text, ';');
      if (item.empty()) {
        continue;
      }
      const auto point = ParsePoint(item);
      if (!point) {
        return InvalidArgument(
            "transfer function: '{}' is not a point; expected V:R,G,B:A with value V, colour 0 to "
            "1 and opacity 0 to 1, points separated by ';'",
            item);
      }
      transfer.points.push_back(*point);
    }
  }
  FOVEA_RETURN_IF_ERROR(Validate(transfer));
  return transfer;
}

std::string FormatTransferFunction(const TransferFunction& transfer) {
  std::string text;
  for (const TransferFunction::Point& p : transfer.points) {
    // fmt's {} is the shortest text that reads back to the same number.
    text += fmt::format("{}{}:{},{},{}:{}", text.empty() ? "" : ";", p.value, p.color.red,
                        p.color.green, p.color.blue, p.opacity);
  }
  return text;
}

namespace {

struct Sample {
  double red, green, blue, sigma;
};

/// The exact function at `value`; at a step, the side that lies towards larger values.
Sample Evaluate(const std::vector<TransferFunction::Point>& points, double value) {
  const auto above =
      std::upper_bound(points.begin(), points.end(), value,
                       [](double v, const TransferFunction::Point& p) { return v < p.value; });
  const TransferFunction::Point& b = above == points.end() ? points.back() : *above;
  const TransferFunction::Point& a = above == points.begin() ? points.front() : *(above - 1);
  const double f =
      b.value > a.value ? std::clamp((value - a.value) / (b.value - a.value), 0.0, 1.0) : 1.0;
  const auto mix = [f](float p, float q) { return p + f * (static_cast<double>(q) - p); };
  const double opacity = std::min(mix(a.opacity, b.opacity), kMostOpacity);
  return {mix(a.color.red, b.color.red), mix(a.color.green, b.color.green),
          mix(a.color.blue, b.color.blue), -std::log1p(-opacity)};
}

}  // namespace

Appearance AppearanceOf(const TransferFunction& transfer, double value) {
  const auto& points = transfer.points;
  const double v = std::isnan(value) ? points.front().value : value;
  const auto above =
      std::lower_bound(points.begin(), points.end(), v,
                       [](const TransferFunction::Point& p, double x) { return p.value < x; });
  const TransferFunction::Point& b = above == points.end() ? points.back() : *above;
  const TransferFunction::Point& a =
      above == points.begin() || above == points.end() ? b : *(above - 1);
  const double f = b.value > a.value ? (v - a.value) / (b.value - a.value) : 0.0;
  const auto mix = [f](float p, float q) { return p + f * (static_cast<double>(q) - p); };
  return {mix(a.color.red, b.color.red), mix(a.color.green, b.color.green),
          mix(a.color.blue, b.color.blue), mix(a.opacity, b.opacity)};
}

TransferTable::TransferTable(const TransferFunction& transfer) : entries_(kEntries) {
  const auto& points = transfer.points;
  double low = points.front().value;
  double high = points.back().value;
  if (!(high > low)) {  // one value: a step, or a constant
    const double margin = std::max(std::abs(low) * 1e-6, 1e-30);
    low -= margin;
    high += margin;
  }
  const double step = (high - low) / (kEntries - 1);
  offset_ = static_cast<float>(low);
  scale_ = static_cast<float>(1.0 / step);
  std::vector<Sample> samples(kEntries);
  for (int i = 0; i < kEntries; ++i) {
    // The ends are what holds outside: the first point before, the last point after.
    const double value = i == 0 ? std::nextafter(low, -INFINITY) : low + i * step;
    samples[i] = Evaluate(points, i == kEntries - 1 ? high : value);
  }
  for (int i = 0; i < kEntries; ++i) {
    const Sample& a = samples[i];
    const Sample& b = samples[std::min(i + 1, kEntries - 1)];
    entries_[i] = {static_cast<float>(a.red),           static_cast<float>(a.green),
                   static_cast<float>(a.blue),          static_cast<float>(a.sigma),
                   static_cast<float>(b.red - a.red),   static_cast<float>(b.green - a.green),
                   static_cast<float>(b.blue - a.blue), static_cast<float>(b.sigma - a.sigma)};
  }
}

}  // namespace fovea::render
