#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>
#include <vector>

#include "engine/render/renderer.h"
#include "service/frames/encode.h"
#include "service/frames/foveated_codec.h"
#include "service/wire/convert.h"

namespace fovea::wire {
namespace {

v1::FrameStats ToProto(const frames::FrameStats& stats) {
  v1::FrameStats proto;
  proto.set_coefficients(stats.coefficients);
  proto.set_chunks_read(stats.chunks_read);
  proto.set_chunks_total(stats.chunks_total);
  proto.set_bytes_read(stats.bytes_read);
  proto.set_super_voxels(stats.super_voxels);
  proto.set_samples(stats.samples);
  proto.set_read_ms(stats.read_ms);
  proto.set_reconstruct_ms(stats.reconstruct_ms);
  proto.set_render_ms(stats.render_ms);
  proto.set_smooth_warp_ms(stats.smooth_warp_ms);
  proto.set_encode_ms(stats.encode_ms);
  return proto;
}

frames::FrameStats FromProto(const v1::FrameStats& proto) {
  frames::FrameStats stats;
  stats.coefficients = proto.coefficients();
  stats.chunks_read = proto.chunks_read();
  stats.chunks_total = proto.chunks_total();
  stats.bytes_read = proto.bytes_read();
  stats.super_voxels = proto.super_voxels();
  stats.samples = proto.samples();
  stats.read_ms = proto.read_ms();
  stats.reconstruct_ms = proto.reconstruct_ms();
  stats.render_ms = proto.render_ms();
  stats.smooth_warp_ms = proto.smooth_warp_ms();
  stats.encode_ms = proto.encode_ms();
  return stats;
}

using WarningsProto = google::protobuf::RepeatedPtrField<v1::Warning>;

void AddWarnings(const std::vector<frames::Warning>& warnings, WarningsProto* proto) {
  for (const frames::Warning& warning : warnings) {
    v1::Warning& out = *proto->Add();
    out.set_code(warning.code == frames::Warning::Code::kNotRetained ? v1::Warning::NOT_RETAINED
                                                                     : v1::Warning::DATA_LOSS);
    out.set_message(warning.message);
    out.set_count(warning.count);
  }
}

std::vector<frames::Warning> FromProto(const WarningsProto& proto) {
  std::vector<frames::Warning> warnings;
  for (const v1::Warning& warning : proto) {
    const bool not_retained = warning.code() == v1::Warning::NOT_RETAINED;
    warnings.push_back(
        {warning.message(), warning.count(),
         not_retained ? frames::Warning::Code::kNotRetained : frames::Warning::Code::kDataLoss});
  }
  return warnings;
}

/// Whether the pixels can be what size and encoding say; compressed ones are known by their first
/// bytes.
Status CheckPixels(const v1::Frame& proto, frames::Encoding encoding) {
  const int64_t width = proto.width_px();
  const int64_t height = proto.height_px();
  const auto size = static_cast<int64_t>(proto.pixels().size());
  if (width < 1 || width > render::kMaxPicturePixels || height < 1 ||
      height > render::kMaxPicturePixels) {
    return Internal("a frame of {} x {} pixels, outside 1 to {}", width, height,
                    render::kMaxPicturePixels);
  }
  if (const int64_t pixel_bytes = RawPixelBytes(encoding); pixel_bytes != 0) {
    if (size != pixel_bytes * width * height) {
      return Internal("a frame of {} x {} pixels at {} bytes came with {} bytes", width, height,
                      pixel_bytes, size);
    }
    return absl::OkStatus();
  }
  const std::string_view signature = encoding == frames::Encoding::kPng    ? "\x89PNG\r\n\x1a\n"
                                     : encoding == frames::Encoding::kJpeg ? "\xff\xd8\xff"
                                                                           : frames::kFoveatedMagic;
  if (!proto.pixels().starts_with(std::string(signature))) {
    return Internal("a frame said to be {} does not start like one",
                    frames::EncodingName(encoding));
  }
  return absl::OkStatus();
}

}  // namespace

v1::Frame ToProto(frames::Frame frame) {
  v1::Frame proto;
  proto.set_dataset(std::move(frame.dataset));
  proto.set_step(static_cast<uint64_t>(frame.step));
  proto.set_time_ns(frame.time_ns);
  if (frame.frame_number) {
    proto.set_frame_number(*frame.frame_number);
  }
  *proto.mutable_used() = ToProto(frame.used);
  proto.set_width_px(static_cast<uint32_t>(frame.width_px));
  proto.set_height_px(static_cast<uint32_t>(frame.height_px));
  proto.set_encoding(ToProto(frame.encoding));
  proto.set_pixels(std::move(frame.pixels));
  *proto.mutable_stats() = ToProto(frame.stats);
  proto.set_index(frame.index);
  AddWarnings(frame.warnings, proto.mutable_warnings());
  return proto;
}

StatusOr<frames::Frame> FromProto(v1::Frame proto) {
  frames::Frame frame;
  auto encoding = EncodingFromProto(proto.encoding(), "encoding");
  auto used = FromProto(proto.used(), "used");
  if (!encoding.ok() || !used.ok()) {
    const Status& status = encoding.ok() ? used.status() : encoding.status();
    return Internal("a frame that this client does not understand: {}", MessageOf(status));
  }
  FOVEA_RETURN_IF_ERROR(CheckPixels(proto, *encoding));
  if (proto.step() > static_cast<uint64_t>(std::numeric_limits<int64_t>::max())) {
    return Internal("a frame of step {}", proto.step());
  }
  frame.dataset = proto.dataset();
  frame.step = static_cast<int64_t>(proto.step());
  frame.time_ns = proto.time_ns();
  if (proto.has_frame_number()) {
    frame.frame_number = proto.frame_number();
  }
  frame.used = *std::move(used);
  frame.width_px = static_cast<int>(proto.width_px());
  frame.height_px = static_cast<int>(proto.height_px());
  frame.encoding = *encoding;
  frame.pixels = std::move(*proto.mutable_pixels());
  frame.stats = FromProto(proto.stats());
  frame.index = proto.index();
  frame.warnings = FromProto(proto.warnings());
  return frame;
}

v1::FramePlan ToProto(const std::string& dataset, int64_t step, const frames::FramePlan& plan) {
  v1::FramePlan proto;
  proto.set_dataset(dataset);
  proto.set_step(static_cast<uint64_t>(step));
  *proto.mutable_used() = ToProto(plan.used);
  proto.set_coefficients(plan.coefficients);
  proto.set_super_voxels(static_cast<uint64_t>(plan.counts.super_voxels));
  proto.set_samples(static_cast<uint64_t>(plan.counts.samples));
  proto.set_chunks_read(plan.chunks_read);
  proto.set_chunks_total(plan.chunks_total);
  proto.set_bytes_read(plan.bytes_read);
  proto.set_memory_bytes(static_cast<uint64_t>(plan.counts.memory_bytes));
  proto.set_threads(static_cast<uint32_t>(plan.threads));
  proto.set_read_ms(plan.time.read_ms);
  proto.set_reconstruct_ms(plan.time.reconstruct_ms);
  proto.set_render_ms(plan.time.render_ms);
  proto.set_smooth_warp_ms(plan.time.smooth_warp_ms);
  proto.set_total_ms(plan.time.Total());
  AddWarnings(plan.warnings, proto.mutable_warnings());
  return proto;
}

StatusOr<frames::FramePlan> FromProto(const v1::FramePlan& proto) {
  auto used = FromProto(proto.used(), "used");
  if (!used.ok()) {
    return Internal("a plan that this client does not understand: {}", MessageOf(used.status()));
  }
  constexpr auto kMost = static_cast<uint64_t>(std::numeric_limits<int64_t>::max());
  const uint64_t counts[] = {proto.super_voxels(), proto.samples(), proto.memory_bytes()};
  const double times[] = {proto.read_ms(), proto.reconstruct_ms(), proto.render_ms(),
                          proto.smooth_warp_ms()};
  if (std::any_of(std::begin(counts), std::end(counts), [](auto count) { return count > kMost; }) ||
      std::any_of(std::begin(times), std::end(times),
                  [](double ms) { return !(ms >= 0) || !std::isfinite(ms); }) ||
      proto.threads() < 1 || proto.threads() > std::numeric_limits<int>::max()) {
    return Internal("a plan with counts or times that none can have");
  }
  frames::FramePlan plan;
  plan.used = *std::move(used);
  plan.coefficients = proto.coefficients();
  plan.counts.super_voxels = static_cast<int64_t>(proto.super_voxels());
  plan.counts.samples = static_cast<int64_t>(proto.samples());
  plan.counts.memory_bytes = static_cast<int64_t>(proto.memory_bytes());
  plan.chunks_read = proto.chunks_read();
  plan.chunks_total = proto.chunks_total();
  plan.bytes_read = proto.bytes_read();
  plan.threads = static_cast<int>(proto.threads());
  plan.time = {proto.read_ms(), proto.reconstruct_ms(), proto.render_ms(), proto.smooth_warp_ms()};
  plan.warnings = FromProto(proto.warnings());
  return plan;
}

}  // namespace fovea::wire
