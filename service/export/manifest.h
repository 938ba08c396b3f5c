#ifndef SERVICE_EXPORT_MANIFEST_H_
#define SERVICE_EXPORT_MANIFEST_H_

#include <string>

#include "engine/base/status.h"

/// How an export that is started again knows which of its files are done.
///
/// `.NAME.fovea-export.json` beside the files holds the settings they were made with. A file is
/// done if it is there (files appear whole or not at all), the manifest holds these very settings,
/// and the file is not older than the manifest. Changed settings therefore make every file again,
/// and shards in one folder need not know of each other: whoever comes first writes the manifest,
/// and the others find it.
namespace fovea::exports {

class Manifest {
 public:
  /// `folder_and_stem`: for f.####.png "f.png", for shot.mp4 "shot.mp4", with their folder.
  /// `settings`: a text that is equal exactly when the pictures would be.
  Manifest(const std::string& folder_and_stem, std::string settings);

  enum class State {
    kNone,     // no manifest: files with these names are not ours
    kChanged,  // made with other settings
    kSame,
  };
  /// Reads what is there.
  [[nodiscard]] State Check() const;
  /// Writes the settings; from now on only files made later count as done.
  [[nodiscard]] Status Write() const;
  /// Whether this file, made with the settings of the manifest, is done.
  [[nodiscard]] bool IsDone(const std::string& path) const;

  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::string text_;
};

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_MANIFEST_H_
