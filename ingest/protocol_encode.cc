#include "ingest/payload.h"
#include "ingest/protocol.h"

namespace fovea::ingest {
namespace {

/// A list goes on in another frame past this; a path adds at most a few thousand bytes.
constexpr size_t kFullFrameBytes = kMaxPayloadBytes / 2;

void WriteTexts(const std::vector<std::string>& texts, PayloadWriter* writer) {
  writer->Number(static_cast<uint32_t>(texts.size()));
  for (const std::string& text : texts) {
    writer->Text(text);
  }
}

void WriteHints(const ReaderHints& hints, PayloadWriter* writer) {
  writer->Number(static_cast<uint8_t>(hints.raw.has_value()));
  if (hints.raw) {
    const RawFormat& raw = *hints.raw;
    writer->Number(raw.dims.x).Number(raw.dims.y).Number(raw.dims.z).Text(raw.type);
    writer->Number(static_cast<uint8_t>(raw.big_endian));
    writer->Number(raw.header_bytes).Number(raw.steps_per_file);
  }
  writer->Text(hints.channel).Text(hints.axes).Number(hints.slices_per_step);
}

}  // namespace

Frame Encode(const ScanRequest& message) {
  PayloadWriter writer;
  WriteTexts(message.paths, &writer);
  WriteHints(message.hints, &writer);
  writer.Number(static_cast<uint8_t>(message.from_voxels));
  return {FrameKind::kScan, writer.Take()};
}

Frame Encode(const ReadRequest& message) {
  PayloadWriter writer;
  WriteTexts(message.paths, &writer);
  WriteHints(message.hints, &writer);
  writer.Number(message.step_in_file).Box(message.extent);
  WriteTexts(message.grids, &writer);
  writer.Number<uint8_t>(message.lattice ? 1 : 0);
  for (const double element : message.lattice.value_or(Matrix4{}).m) {
    writer.Number(element);
  }
  return {FrameKind::kRead, writer.Take()};
}

Frame Encode(const PictureRequest& message) {
  PayloadWriter writer;
  writer.Text(message.format).Number(message.width).Number(message.height);
  return {FrameKind::kPicture, writer.Take()};
}

Frame Encode(const FileInfo& message) {
  PayloadWriter writer;
  writer.Number(message.file_bytes).Text(message.world_unit);
  writer.Number(static_cast<uint8_t>(message.is_dense)).Number(message.steps);
  writer.Number(static_cast<uint32_t>(message.times_s.size()));
  for (const double time : message.times_s) {
    writer.Number(time);
  }
  WriteTexts(message.needs, &writer);
  WriteTexts(message.warnings, &writer);
  return {FrameKind::kFile, writer.Take()};
}

Frame Encode(const GridInfo& message) {
  PayloadWriter writer;
  writer.Text(message.name).Text(message.type).Text(message.problem).Box(message.box);
  for (const double element : message.index_to_world.m) {
    writer.Number(element);
  }
  writer.Number(message.declared_bytes).Text(message.value_unit);
  writer.Number<uint8_t>(message.on_request ? 1 : 0);
  return {FrameKind::kGrid, writer.Take()};
}

Frame Encode(const FieldStart& message) {
  PayloadWriter writer;
  writer.Number(message.index).Number(message.background).Number(message.fill);
  return {FrameKind::kField, writer.Take()};
}

Frame Encode(const FieldEnd& message) {
  PayloadWriter writer;
  writer.Box(message.active).Number(message.rounded);
  return {FrameKind::kFieldEnd, writer.Take()};
}

Frame Encode(const DenseStart& message) {
  PayloadWriter writer;
  writer.Number(message.index).Number(static_cast<uint8_t>(message.type)).Box(message.box);
  return {FrameKind::kDense, writer.Take()};
}

Frame Encode(const SlabRows& message) {
  PayloadWriter writer;
  writer.Number(message.slab).Number(message.rows);
  return {FrameKind::kSlab, writer.Take()};
}

Frame EncodeSlabFree(uint32_t slab) {
  PayloadWriter writer;
  writer.Number(slab);
  return {FrameKind::kSlabFree, writer.Take()};
}

Frame EncodeBlock(const Box3& box, std::span<const float> values) {
  PayloadWriter writer;
  writer.Box(box).Floats(values);
  return {FrameKind::kBlock, writer.Take()};
}

Frame Encode(const Tile& message) {
  PayloadWriter writer;
  writer.Box(message.box).Number(message.value);
  return {FrameKind::kTile, writer.Take()};
}

std::vector<Frame> EncodeFiles(std::span<const std::string> paths) {
  std::vector<Frame> frames;
  for (const std::string& path : paths) {
    if (frames.empty() || frames.back().payload.size() > kFullFrameBytes) {
      frames.push_back({FrameKind::kFiles, ""});
    }
    frames.back().payload += PayloadWriter().Text(path).Take();
  }
  return frames;
}

Frame Encode(const BeginRequest& message) {
  PayloadWriter writer;
  writer.Number(static_cast<uint8_t>(message.pictures));
  return {FrameKind::kBegin, writer.Take()};
}

Frame Encode(const Hello& message) {
  PayloadWriter writer;
  writer.Number(message.version).Number(message.landlock_abi);
  writer.Number(static_cast<uint8_t>(message.system_calls_filtered));
  writer.Text(message.openvdb).Text(message.openimageio);
  return {FrameKind::kHello, writer.Take()};
}

Frame EncodeError(const Status& status) {
  PayloadWriter writer;
  writer.Number(static_cast<uint32_t>(status.code()));
  writer.Text(std::string(MessageOf(status).substr(0, kMaxPayloadBytes / 2)));
  return {FrameKind::kError, writer.Take()};
}

}  // namespace fovea::ingest
