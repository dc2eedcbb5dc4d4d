// Written by `cargo xtask web`; changes are lost.

export const text = "fn Tas(Te:u32,T2:vec2<f32>,T0:u32)->vec4<f32>{let T5k=(Te==1u)&(T3.Teh==1u);let T6=Tc(select(T3.Tki,T3.Tkj,T5k),T0);let at=T2*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Tv=floor(at);let Ty=T29(vec2<i32>(Tv),T6);let T1t=T5c(Ty,T29(vec2<i32>(Tv)+vec2<i32>(1),T6),at-Tv);var a=vec4<f32>(0.0);if!T5k{a=T42(T96,T1t,T0);}var b=a;if T5k|(T3.T4t==T4v){b=T42(Te3,T1t,T0);}return T2n(select(a,b,T5k),b,T3.T4t);}\n";
