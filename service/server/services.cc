#include "service/server/services.h"

namespace fovea::server {

Status DrainingError() {
  return Unavailable("the server is shutting down and takes no new calls; ask another, or later");
}

}  // namespace fovea::server
