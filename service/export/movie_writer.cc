#include "service/export/movie_writer.h"

#include <cstring>
#include <filesystem>
#include <utility>
#include <vector>

namespace fovea::exports {
namespace {

struct MovieFormat {
  std::string_view ending;
  const char* muxer;
  const char* encoder;
  std::vector<const char*> options;
};

const MovieFormat* FormatOf(const std::string& path) {
  // crf 18 is visually lossless for H.264; 24 is about the same for VP9.
  static const std::vector<MovieFormat> formats = {
      {".mp4", "mp4", "libx264", {"-crf", "18", "-movflags", "+faststart"}},
      {".mov", "mov", "libx264", {"-crf", "18", "-movflags", "+faststart"}},
      {".webm", "webm", "libvpx-vp9", {"-crf", "24", "-b:v", "0", "-row-mt", "1"}},
  };
  const std::string ending = std::filesystem::path(path).extension().string();
  for (const MovieFormat& format : formats) {
    if (ending == format.ending) {
      return &format;
    }
  }
  return nullptr;
}

std::vector<std::string> Arguments(const MovieFormat& format, int width, int height,
                                   double frames_per_second, const std::string& output) {
  std::vector<std::string> arguments = {
      "ffmpeg",
      "-hide_banner",
      "-nostdin",
      "-nostats",
      "-loglevel",
      "error",
      "-xerror",
      "-y",
      "-f",
      "rawvideo",
      "-pixel_format",
      "rgb0",
      "-video_size",
      fmt::format("{}x{}", width, height),
      "-framerate",
      fmt::format("{}", frames_per_second),
      "-i",
      "pipe:0",
      "-vf",
      "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv",
      "-pix_fmt",
      "yuv420p",
      "-color_primaries",
      "bt709",
      "-color_trc",
      "iec61966-2-1",
      "-colorspace",
      "bt709",
      "-color_range",
      "tv",
      "-c:v",
      format.encoder};
  arguments.insert(arguments.end(), format.options.begin(), format.options.end());
  // file: keeps a colon in the name from being read as a protocol.
  arguments.insert(arguments.end(), {"-f", format.muxer, "file:" + output});
  return arguments;
}

}  // namespace

bool IsMovie(const std::string& path) {
  return FormatOf(path) != nullptr;
}

Status MovieWriter::CheckEncoder(const std::string& path) {
  const std::string name = FormatOf(path)->encoder;
  const StatusOr<ProgramResult> result = RunProgram({"ffmpeg", "-hide_banner", "-encoders"});
  if (!result.ok()) {
    return Annotate(result.status(),
                    fmt::format("movies need ffmpeg (Debian: apt-get install ffmpeg), or export "
                                "numbered pictures such as f.####.png instead; {}",
                                path));
  }
  if (result->output.find(" " + name + " ") == std::string::npos) {
    return NotFound(
        "{}: the ffmpeg on the PATH has no encoder {}; install Debian's ffmpeg package, "
        "which has it, or export numbered pictures such as f.####.png",
        path, name);
  }
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<MovieWriter>> MovieWriter::Open(const std::string& path, int width,
                                                         int height, double frames_per_second) {
  FOVEA_ASSIGN_OR_RETURN(OutputFile file, OutputFile::Create(path));
  FOVEA_ASSIGN_OR_RETURN(FedProgram encoder,
                         FedProgram::Start(Arguments(*FormatOf(path), width, height,
                                                     frames_per_second, file.temporary_path())));
  return std::unique_ptr<MovieWriter>(new MovieWriter(path, std::move(file), std::move(encoder)));
}

Status MovieWriter::Failure(const ProgramResult& result) const {
  if (result.exit_status > 128) {
    return FailedPrecondition("{}: ffmpeg was ended by a signal: {}", path_,
                              ::strsignal(result.exit_status - 128));
  }
  return FailedPrecondition("{}: ffmpeg could not write the movie (exit status {}): {}", path_,
                            result.exit_status,
                            result.errors.empty() ? "it said nothing" : result.errors);
}

Status MovieWriter::Write(std::string_view rgba) {
  return encoder_.Write(rgba) ? absl::OkStatus() : Failure(encoder_.Finish());
}

Status MovieWriter::Finish() {
  const ProgramResult result = encoder_.Finish();
  // ffmpeg ends with 0 after some write errors, but never without saying so.
  if (result.exit_status != 0 || !result.errors.empty()) {
    return Failure(result);
  }
  return file_.Commit();
}

}  // namespace fovea::exports
