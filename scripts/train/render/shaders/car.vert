#version 330
uniform mat4 clip_from_world;
uniform mat4 world_from_car;
uniform vec4 wheels; // x of the front and rear hubs, their height, a wheel's width along x by its height
uniform float rolled; // by how much the wheels have turned forwards, rad
in vec3 in_position;
in vec3 in_normal;
in float in_material;
out vec3 position;
out vec3 position_in_car;
out vec3 normal;
flat out int material;

// Materials that wheels are made of, as in cars/mesh.py.
const int TYRE = 2, RIM = 3, GAP = 11;

// Turns what lies within a wheel; a stretched one turns as the circle that it was.
void roll(inout vec3 point, inout vec3 direction) {
    vec2 scale = vec2(wheels.w, 1.0);
    vec2 hub = vec2(point.x > 0.5 * (wheels.x + wheels.y) ? wheels.x : wheels.y, wheels.z);
    vec2 away = (point.xz - hub) / scale;
    if (length(away) > 1.001 * wheels.z)
        return;
    mat2 turn = mat2(cos(rolled), -sin(rolled), sin(rolled), cos(rolled));
    point.xz = hub + turn * away * scale;
    direction.xz = turn * direction.xz;
}

void main() {
    vec3 point = in_position, direction = in_normal;
    material = int(in_material + 0.5);
    if (rolled != 0.0 && (material == TYRE || material == RIM || material == GAP))
        roll(point, direction);
    vec4 p = world_from_car * vec4(point, 1.0);
    position = p.xyz;
    position_in_car = point;
    normal = mat3(world_from_car) * direction;
    gl_Position = clip_from_world * p;
}
