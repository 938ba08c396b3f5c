#include "service/server/give_way.h"

#include <sched.h>

namespace fovea::server {

void GiveWay(bool crowded) {
  thread_local bool gives_way = false;
  if (crowded == gives_way) {
    return;
  }
  gives_way = crowded;
  const sched_param none{};
  // Where it is not allowed, all stays as it is: a matter of speed only.
  ::sched_setscheduler(0, crowded ? SCHED_BATCH : SCHED_OTHER, &none);
}

}  // namespace fovea::server
