#ifndef SERVICE_EXPORT_MOVIE_WRITER_H_
#define SERVICE_EXPORT_MOVIE_WRITER_H_

#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "engine/base/status.h"
#include "service/export/output_file.h"
#include "service/export/process.h"

namespace fovea::exports {

/// Whether the file's name asks for a movie: .mp4, .mov or .webm.
[[nodiscard]] bool IsMovie(const std::string& path);

/// Encodes raw frames through the ffmpeg program. The movie appears under its name when Finish
/// succeeds; destroyed before that, nothing is left. Not thread-safe.
class MovieWriter {
 public:
  /// Checks that ffmpeg is there and has the encoder (H.264, or VP9 for .webm): call it before
  /// rendering anything. NOT_FOUND says what to install.
  [[nodiscard]] static Status CheckEncoder(const std::string& path);

  /// `width`, `height`: of the frames; odd sizes are padded to even with black.
  [[nodiscard]] static StatusOr<std::unique_ptr<MovieWriter>> Open(const std::string& path,
                                                                   int width, int height,
                                                                   double frames_per_second);
  /// One frame, RAW_RGBA8: 4 * width * height bytes, the alpha of which does not count.
  [[nodiscard]] Status Write(std::string_view rgba);
  [[nodiscard]] Status Finish();

 private:
  MovieWriter(std::string path, OutputFile file, FedProgram encoder)
      : path_(std::move(path)), file_(std::move(file)), encoder_(std::move(encoder)) {}
  [[nodiscard]] Status Failure(const ProgramResult& result) const;

  std::string path_;
  OutputFile file_;
  FedProgram encoder_;
};

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_MOVIE_WRITER_H_
