// Written by `cargo xtask web`; changes are lost.

export const text = "fn Tae(Te:u32,T2:vec2<f32>,T0:u32)->vec4<f32>{let T56=(Te==1u)&(T3.Tdy==1u);let T4=Tc(select(T3.Tjt,T3.Tju,T56),T0);let at=T2*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Tx=floor(at);let Tv=T23(vec2<i32>(Tx),T4);let T1o=T51(Tv,T23(vec2<i32>(Tx)+vec2<i32>(1),T4),at-Tx);var a=vec4<f32>(0.0);if!T56{a=T3x(T8t,T1o,T0);}var b=a;if T56|(T3.T4j==T4l){b=T3x(Tdl,T1o,T0);}return T2e(select(a,b,T56),b,T3.T4j);}\n";
