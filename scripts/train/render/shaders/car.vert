#version 330
uniform mat4 clip_from_world;
uniform mat4 world_from_car;
in vec3 in_position;
in vec3 in_normal;
in float in_material;
out vec3 position;
out vec3 position_in_car;
out vec3 normal;
flat out int material;

void main() {
    vec4 p = world_from_car * vec4(in_position, 1.0);
    position = p.xyz;
    position_in_car = in_position;
    normal = mat3(world_from_car) * in_normal;
    material = int(in_material + 0.5);
    gl_Position = clip_from_world * p;
}
