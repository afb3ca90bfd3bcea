component autotune_test_axes "Two simulated axes behind a socket: one exchange in each servo period.";
pin in float torque_# [2] "of the controller [N m]";
pin in float offset_# [2] "torque offset [N m]";
pin in float position_# [2] "commanded [rad]";
pin in float velocity_# [2] "commanded [rad/s]";
pin in float acceleration_# [2] "commanded [rad/s^2]";
pin in bit powered;
pin in bit true_inverse "the axes add the torque offset of their own inverse";
pin out float measured_# [2] "[rad]";
variable int line = -1;
variable int asked = 0;
function hear fp;
function tell fp;
license "Apache-2.0";
author "autotune";
;;
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define SOCKET "axes.sock"

static int connected(void)
{
    struct sockaddr_un address;
    int wire = socket(AF_UNIX, SOCK_SEQPACKET, 0);

    memset(&address, 0, sizeof address);
    address.sun_family = AF_UNIX;
    strncpy(address.sun_path, SOCKET, sizeof address.sun_path - 1);
    if (wire >= 0 && connect(wire, (struct sockaddr *)&address, sizeof address) != 0) {
        close(wire);
        wire = -1;
    }
    return wire;
}

FUNCTION(hear)
{
    double answer[2];

    if (asked && recv(line, answer, sizeof answer, 0) == (ssize_t)sizeof answer) {
        measured(0) = answer[0];
        measured(1) = answer[1];
    }
    asked = 0;
}

FUNCTION(tell)
{
    double told[12];
    int i;

    if (line < 0) {
        line = connected();
    }
    told[0] = powered;
    told[1] = true_inverse;
    for (i = 0; i < 2; i++) {
        told[2 + 5 * i] = torque(i);
        told[3 + 5 * i] = offset(i);
        told[4 + 5 * i] = position(i);
        told[5 + 5 * i] = velocity(i);
        told[6 + 5 * i] = acceleration(i);
    }
    asked = line >= 0 && send(line, told, sizeof told, MSG_NOSIGNAL) == (ssize_t)sizeof told;
}
